#include "ktgp_orb/ground_motion.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "motion/base_report.h"
#include "motion/ground_filter.h"
#include "motion/relief.h"
#include "motion/twist_noise.h"
#include "motion/validity.h"

namespace ktgp_orb {
namespace {

using motion::CameraPose;
using motion::GroundFilter;
using motion::ImageMotion;
using motion::Matrix6;
using motion::Vector6;
using util::propagated;

constexpr double kNoLimit = 1e300;
constexpr double kHomographyLimit = 10.0;  // deviations
constexpr int kPatience = 10;              // contradictions one after the other
constexpr double kUnknownTilt = 0.35;      // rad
constexpr double kOrigin = 1e-6;  // deviation of the origin: a share of the height, and rad

/// Rotation by `yaw` about z.
Eigen::Matrix3d aboutUp(double yaw) {
  return motion::rotationAbout(yaw * Eigen::Vector3d::UnitZ());
}

double yawOf(const Eigen::Matrix3d& axes) {
  return std::atan2(axes(1, 0), axes(0, 0));
}

}  // namespace

struct GroundMotion::Impl {
  struct Destination {
    Pose3 base;
    Covariance6 covariance;
  };

  const GroundEstimate& add(const GroundFrame& frame);
  void forget();
  GroundStatus follow(const GroundFrame& frame);
  GroundStatus beginAt(const GroundFrame& frame, const ImageMotion& image);
  GroundStatus connect(const GroundFrame& frame, const ImageMotion& image);
  CameraPose firstPose(const GroundFrame& frame) const;
  CameraPose onGround(const GroundFrame& frame, const CameraPose& pose) const;
  void predict(double seconds);
  void useReadings(const GroundFrame& frame);
  void widenForReadings(const GroundFrame& frame);
  void roughen();
  void moveToDestination();
  void beginMap(const GroundFrame& frame, const ImageMotion& image);
  void measureTwist(double seconds);
  double sinceLast(const GroundFrame& frame) const {
    return 1e-9 * static_cast<double>(frame.stamp - last_stamp);
  }

  GroundMotionOptions options;
  GroundFilter filter;
  GroundEstimate estimate;
  bool has_pose = false;      // of the frame at last_stamp
  bool is_connected = false;  // the map of the keyframe is valid
  std::int64_t last_stamp = 0;
  std::int64_t newest_stamp = 0;  // also of frames without a homography
  bool has_frame = false;
  std::int64_t keyframe_stamp = 0;
  Eigen::Vector3d keyframe_position = Eigen::Vector3d::Zero();
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // where lengths count from
  Vector6 camera_twist = Vector6::Zero();            // of the camera, in its frame
  Matrix6 camera_twist_covariance = Matrix6::Zero();
  motion::TwistNoise twist_noise;
  motion::Relief relief;
  int contradictions = 0;
  std::optional<Destination> destination;
};

const GroundEstimate& GroundMotion::Impl::add(const GroundFrame& frame) {
  motion::requireValid(frame);
  if (has_frame && frame.stamp == newest_stamp) {
    throw std::invalid_argument("the frame has the stamp of the previous one; expected a new one");
  }
  estimate = {};
  const bool went_back = has_frame && frame.stamp < newest_stamp;
  newest_stamp = frame.stamp;
  has_frame = true;
  if (went_back) has_pose = is_connected = false;
  estimate.status = went_back ? GroundStatus::stamp_went_back : follow(frame);
  if (!filter.isFinite()) forget();
  if (estimate.hasPose()) {
    last_stamp = frame.stamp;
    const motion::CameraMotion camera{filter.pose(), filter.covariance(), camera_twist,
                                      camera_twist_covariance};
    motion::reportBase(camera, origin, options, estimate);
  } else if (estimate.status == GroundStatus::no_normal) {
    last_stamp = frame.stamp;
  }
  return estimate;
}

/// What cannot be computed with must not stay: the motion begins anew with the next frame.
void GroundMotion::Impl::forget() {
  estimate = {};
  estimate.status = GroundStatus::not_finite;
  filter = {};
  twist_noise = {};
  relief = {};
  has_pose = is_connected = false;
}

GroundStatus GroundMotion::Impl::follow(const GroundFrame& frame) {
  if (!frame.homography) return GroundStatus::no_homography;
  if (!motion::isUsable(frame.covariance)) return GroundStatus::no_covariance;
  const ImageMotion image = motion::inImageUnits(*frame.homography, frame.covariance, frame.camera);
  const bool from_last = frame.reference_stamp == last_stamp;
  if (is_connected && (from_last || frame.reference_stamp == keyframe_stamp)) {
    if (from_last && frame.reference_stamp != keyframe_stamp) {
      roughen();
      filter.setKeyframe(image, true);
      twist_noise.beginKeyframe();
      keyframe_stamp = frame.reference_stamp;
    }
    return connect(frame, image);
  }
  return beginAt(frame, image);
}

/// A pose for a frame that nothing connects to the frames before it.
GroundStatus GroundMotion::Impl::beginAt(const GroundFrame& frame, const ImageMotion& image) {
  const bool resumes = has_pose;
  if (!resumes && !frame.height) return GroundStatus::no_height;
  if (resumes) {
    estimate.gap = sinceLast(frame);
    predict(estimate.gap);
  } else {
    const CameraPose first = firstPose(frame);
    if (!meetsGround(*frame.height, first)) {
      estimate.height_misfit = std::numeric_limits<double>::infinity();
      return GroundStatus::no_height;
    }
    Vector6 variances;
    const double exact = kOrigin * frame.height->metres;
    variances << exact * exact, exact * exact, 0.0, 0.0, 0.0, kOrigin * kOrigin;
    Matrix6 covariance = variances.asDiagonal();
    covariance.bottomRightCorner<3, 3>() =
        first.axes.transpose() * covariance.bottomRightCorner<3, 3>() * first.axes;
    filter.start(first, covariance);
    origin = Eigen::Vector3d::Zero();
    camera_twist.setZero();
    camera_twist_covariance.setZero();
    camera_twist_covariance.diagonal().head<3>().setConstant(std::pow(options.acceleration, 2));
    camera_twist_covariance.diagonal().tail<3>().setConstant(
        std::pow(options.turn_acceleration, 2));
  }
  widenForReadings(frame);
  useReadings(frame);
  contradictions = 0;
  if (destination) moveToDestination();
  beginMap(frame, image);
  has_pose = is_connected = true;
  if (estimate.tilt_deviation > options.max_tilt_deviation) return GroundStatus::no_normal;
  return resumes ? GroundStatus::resumed : GroundStatus::started;
}

/// A pose from the homography to the keyframe.
GroundStatus GroundMotion::Impl::connect(const GroundFrame& frame, const ImageMotion& image) {
  const GroundFilter before = filter;
  if (!filter.advance(image) || !(filter.useRest(kHomographyLimit) <= kHomographyLimit)) {
    filter = before;
    if (++contradictions >= kPatience) is_connected = false;
    return GroundStatus::contradiction;
  }
  const Eigen::Vector3d& position = filter.now().position;
  relief.add(frame.plane_deviation / frame.camera(0, 0), position.head<2>().norm() / position.z());
  if (frame.turn) filter.use(*frame.turn, kNoLimit);
  useReadings(frame);
  measureTwist(sinceLast(frame));
  if (destination) {
    moveToDestination();
    beginMap(frame, image);
  }
  // The ground is not where earlier frames saw it: begin with the readings, at the next frame.
  if (contradictions >= kPatience) is_connected = false;
  if (estimate.tilt_deviation > options.max_tilt_deviation) return GroundStatus::no_normal;
  return GroundStatus::ok;
}

/// The pose with the given height and normal, and the base where it was: it turns as little as
/// possible.
CameraPose GroundMotion::Impl::onGround(const GroundFrame& frame, const CameraPose& pose) const {
  CameraPose placed = pose;
  const Eigen::Vector3d lever = options.camera_to_base.inverse().translation();
  const Eigen::Vector3d base = pose.position + pose.axes * lever;
  if (frame.down) {
    const Eigen::Vector3d down = -pose.axes.row(2).transpose();
    placed.axes = pose.axes * motion::rotationBetween(frame.down->direction, down);
  }
  placed.position.head<2>() = (base - placed.axes * lever).head<2>();
  if (frame.height && meetsGround(*frame.height, placed)) {
    const motion::PoseRows<1> rows = rowsOf(*frame.height, placed, 0.0);
    placed.position.z() += rows.residual(0) / rows.slope(2);
  }
  return placed;
}

/// Above the origin, with the base's x axis along x.
CameraPose GroundMotion::Impl::firstPose(const GroundFrame& frame) const {
  CameraPose pose;
  pose.axes = options.camera_to_base.linear();
  pose.position.z() = frame.height->metres;
  pose = onGround(frame, pose);
  const Pose3 base_to_camera = options.camera_to_base.inverse();
  pose.axes = aboutUp(-yawOf(pose.axes * base_to_camera.linear())) * pose.axes;
  pose.position.head<2>() = -(pose.axes * base_to_camera.translation()).head<2>();
  return pose;
}

/// Moves the pose on with its last velocity.
void GroundMotion::Impl::predict(double seconds) {
  const CameraPose last = filter.pose();
  const Eigen::Matrix3d turn = motion::rotationAbout(seconds * camera_twist.tail<3>());
  const CameraPose next{last.axes * turn,
                        last.position + seconds * (last.axes * camera_twist.head<3>())};
  Matrix6 by_pose = Matrix6::Identity();
  by_pose.bottomRightCorner<3, 3>() = turn.transpose();
  Matrix6 by_twist = seconds * Matrix6::Identity();
  by_twist.topLeftCorner<3, 3>() *= last.axes;
  Matrix6 covariance =
      propagated(by_pose, filter.covariance()) + propagated(by_twist, camera_twist_covariance);
  const double half_square = 0.5 * seconds * seconds;
  covariance.diagonal().head<3>().array() += std::pow(half_square * options.acceleration, 2);
  covariance.diagonal().tail<3>().array() += std::pow(half_square * options.turn_acceleration, 2);
  filter.start(next, covariance);
}

/// What is not connected to earlier frames takes height and normal from the readings alone.
void GroundMotion::Impl::widenForReadings(const GroundFrame& frame) {
  const CameraPose placed = onGround(frame, filter.pose());
  Matrix6 more = Matrix6::Zero();
  if (frame.height && meetsGround(*frame.height, placed)) {
    more(2, 2) = frame.height->metres * frame.height->metres;
  }
  if (frame.down || !has_pose) {
    const Eigen::Matrix3d& axes = filter.pose().axes;
    const Eigen::Vector3d level(1.0, 1.0, 0.0);
    more.bottomRightCorner<3, 3>() =
        kUnknownTilt * kUnknownTilt * (axes.transpose() * level.asDiagonal() * axes);
  }
  filter.start(placed, filter.covariance() + more);
}

void GroundMotion::Impl::useReadings(const GroundFrame& frame) {
  const double limit = GroundEstimate::kContradiction;
  const CameraPose now = filter.now();
  if (frame.height) {
    const double rise = now.axes.row(2).dot(camera_twist.head<3>());
    estimate.height_misfit = filter.use(rowsOf(relief.widened(*frame.height), now, rise), limit);
    estimate.height_used = estimate.height_misfit <= limit;
  }
  if (frame.down) {
    estimate.down_misfit = filter.use(rowsOf(relief.widened(*frame.down), filter.now()), limit);
    estimate.down_used = estimate.down_misfit <= limit;
  }
  const bool contradicts =
      (frame.height && !estimate.height_used) || (frame.down && !estimate.down_used);
  if (contradicts) ++contradictions;
  if (!contradicts && (frame.height || frame.down)) contradictions = 0;
  const Eigen::Matrix3d& axes = filter.now().axes;
  const Eigen::Matrix3d turn =
      axes * filter.covariance().bottomRightCorner<3, 3>() * axes.transpose();
  estimate.tilt_deviation = std::sqrt(std::max(turn(0, 0), turn(1, 1)));
}

/// The ground of the next keyframe is not quite that of this one.
void GroundMotion::Impl::roughen() {
  const CameraPose& now = filter.now();
  const double height = now.position.z();
  const Eigen::Vector3d position = filter.pose().position;
  const double share = (position - keyframe_position).norm() / height;
  const double variance = options.ground_slope * options.ground_slope * share;
  Matrix6 more = Matrix6::Zero();
  more(2, 2) = height * height * variance;
  const Eigen::Vector3d level(1.0, 1.0, 0.0);
  more.bottomRightCorner<3, 3>() =
      variance * (now.axes.transpose() * level.asDiagonal() * now.axes);
  filter.addCovariance(more);
  keyframe_position = position;
}

/// Height and tilt keep their covariance; x, y and yaw get the given one.
void GroundMotion::Impl::moveToDestination() {
  const CameraPose before = filter.pose();
  CameraPose pose = before;
  const Pose3 base_to_camera = options.camera_to_base.inverse();
  const double yaw_now = yawOf(pose.axes * base_to_camera.linear());
  pose.axes = aboutUp(yawOf(destination->base.linear()) - yaw_now) * pose.axes;
  const Eigen::Vector3d lever = pose.axes * base_to_camera.translation();
  pose.position.head<2>() = (destination->base.translation() - lever).head<2>();
  Matrix6 to_axes_of_ground = Matrix6::Identity();
  to_axes_of_ground.bottomRightCorner<3, 3>() = before.axes;
  Matrix6 covariance = propagated(to_axes_of_ground, filter.covariance());
  for (const int i : {0, 1, 5}) {
    covariance.row(i).setZero();
    covariance.col(i).setZero();
  }
  for (const int i : {0, 1, 5}) {
    for (const int j : {0, 1, 5}) covariance(i, j) = destination->covariance(i, j);
    covariance(i, i) += kOrigin * kOrigin;
  }
  to_axes_of_ground.bottomRightCorner<3, 3>() = pose.axes;
  filter.start(pose, propagated(to_axes_of_ground.transpose(), covariance));
  origin = destination->base.translation();
  destination.reset();
}

/// The reference of `image`, which leads to the newest pose, becomes the keyframe.
void GroundMotion::Impl::beginMap(const GroundFrame& frame, const ImageMotion& image) {
  filter.setKeyframe(image, false);
  twist_noise.beginKeyframe();
  keyframe_stamp = frame.reference_stamp;
  keyframe_position = filter.pose().position;
}

void GroundMotion::Impl::measureTwist(double seconds) {
  camera_twist = motion::constantTwist(filter.before(), filter.now()) / seconds;
  const motion::Matrix612 slope = motion::twistSlope(filter.before(), filter.now()) / seconds;
  camera_twist_covariance = propagated(slope, filter.covarianceOfBoth());
  const Matrix6 noise = propagated(slope, filter.noiseOfBoth());
  twist_noise.add(camera_twist, noise, seconds, filter.now().position.z());
  if (!relief.isSeen()) camera_twist_covariance -= noise - twist_noise.scaled(noise);
}

GroundMotion::GroundMotion(const GroundMotionOptions& options) : impl_(std::make_unique<Impl>()) {
  setOptions(options);
}
GroundMotion::~GroundMotion() = default;
GroundMotion::GroundMotion(GroundMotion&&) noexcept = default;
GroundMotion& GroundMotion::operator=(GroundMotion&&) noexcept = default;

const GroundMotionOptions& GroundMotion::options() const {
  return impl_->options;
}

void GroundMotion::setOptions(const GroundMotionOptions& options) {
  motion::requireValid(options);
  impl_->options = options;
}

const GroundEstimate& GroundMotion::add(const GroundFrame& frame) {
  return impl_->add(frame);
}

void GroundMotion::reset() {
  impl_->has_pose = impl_->is_connected = impl_->has_frame = false;
  impl_->destination.reset();
}

void GroundMotion::setPose(const Pose3& base_to_odometry, const Covariance6& covariance) {
  const Covariance6::ConstDiagonalReturnType variances = covariance.diagonal();
  if (!base_to_odometry.matrix().allFinite() || !covariance.allFinite() ||
      !(variances.minCoeff() >= 0.0)) {
    throw std::invalid_argument(
        "the pose or its covariance is not usable; expected finite numbers and variances of at "
        "least 0");
  }
  impl_->destination = {base_to_odometry, covariance};
}

}  // namespace ktgp_orb
