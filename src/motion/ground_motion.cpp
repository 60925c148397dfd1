#include "ktgp_orb/ground_motion.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "core/util/constants.h"
#include "motion/base_report.h"
#include "motion/ground_filter.h"
#include "motion/mounting.h"
#include "motion/relief.h"
#include "motion/shutter.h"
#include "motion/twist_noise.h"
#include "motion/validity.h"

namespace ktgp_orb {
namespace {

using motion::CameraPose;
using motion::GroundFilter;
using motion::ImageMotion;
using motion::Innovation;
using motion::Matrix6;
using motion::Vector6;
using util::propagated;

constexpr double kHomographyLimit = 10.0;  // deviations
constexpr int kPatience = 10;              // frames that are refused, one after the other
constexpr double kUnknownTilt = 0.35;      // rad
constexpr double kHorizon = 0.1;  // share of the optical axis along the direction to the ground
constexpr double kOrigin = 1e-6;  // deviation of the origin: a share of the height, and rad

/// Rotation by `yaw` about z.
Eigen::Matrix3d aboutUp(double yaw) {
  return motion::rotationAbout(yaw * Eigen::Vector3d::UnitZ());
}

double yawOf(const Eigen::Matrix3d& axes) {
  return std::atan2(axes(1, 0), axes(0, 0));
}

/// `down`: to the ground, in the camera's frame.
bool looksDown(const Eigen::Vector3d& down) {
  return down.z() > kHorizon;
}

/// What the innovations of measurements of one kind tell about their noise: covariance matching
/// (Mehra, IEEE Trans. AC 1972), never below the variance that was given.
struct Innovations {
  double variance = 1.0;     // as a multiple of the given one: running mean
  int contradictions = 0;    // one after the other, each on other ground
  bool is_another = false;   // the newest measurement is one of them
  std::int64_t ground = -1;  // of the newest measurement
  Eigen::Vector3d residual = Eigen::Vector3d::Zero();  // of the newest one, in given deviations
  std::array<double, 2> steps{};  // squared, to the newest one and to the one before
  double scatter = 0.0;           // of the smaller steps: running mean, see addResidual()

  /// `on`: a number for the ground that the measurement is about. Contradictions on the same ground
  /// have the same cause, so they count once.
  void add(const Innovation& innovation, std::int64_t on) {
    constexpr double kMeasurements = 30.0;
    constexpr double kMost = 100.0;  // that a single one counts
    constexpr double kDoubt = 4.0;   // deviations
    variance += (std::clamp(innovation.noise, 0.0, kMost) - variance) / kMeasurements;
    const bool contradicts = innovation.misfit > kDoubt;
    if (!contradicts) contradictions = 0;
    is_another = contradicts && (contradictions == 0 || on != ground);
    contradictions += is_another ? 1 : 0;
    ground = on;
  }
  double factor() const { return std::max(1.0, variance); }
  /// Which normal is called a contradiction depends on the noise that the differences of successive
  /// ones show (von Neumann, 1941), since drivers give covariances that are too small. What is
  /// wrong in the same way each time has none. Of three steps in a row the smallest counts, since
  /// an outlier makes two.
  void addResidual(const Eigen::Vector3d& newest) {
    constexpr double kMeasurements = 30.0;
    constexpr double kUsual = 1.48;  // mean of the smallest of three, two directions of variance 1
    const double step = (newest - residual).squaredNorm();
    scatter += (std::min({step, steps[0], steps[1]}) / kUsual - scatter) / kMeasurements;
    steps = {step, steps[0]};
    residual = newest;
  }
  /// In given deviations. A normal that scatters by more is not only noisy.
  double spread() const {
    constexpr double kMost = 10.0;
    return std::clamp(std::sqrt(scatter), 1.0, kMost);
  }
  /// The variance of the state that lets it follow readings that contradict again and again: a
  /// single one does no harm, after about five of them they are right. The first `ignored` ones
  /// change nothing.
  double doubt(double residual, int ignored) const {
    constexpr double kShare = 0.02;
    if (!is_another) return 0.0;
    return kShare * std::max(contradictions - ignored, 0) * residual * residual;
  }
};

}  // namespace

// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): in the order of use
struct GroundMotion::Impl {
  struct Destination {
    Pose3 base;
    Covariance6 covariance;
  };

  /// A pose that is a jump after the last one.
  struct Refused {
    std::int64_t stamp = 0;
    std::int64_t keyframe_stamp = 0;
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  // in the filter's frame
    std::optional<Eigen::Vector3d> velocity;             // in the camera's frame
    int agree = 0;  // refused frames one after the other that continue each other
  };

  const GroundEstimate& add(const GroundFrame& frame);
  void forget();
  void setReadout();
  GroundStatus follow(const GroundFrame& frame);
  GroundStatus beginAt(const GroundFrame& frame, const ImageMotion& image);
  GroundStatus resume(const GroundFrame& frame, const ImageMotion& image);
  GroundStatus placed(const GroundFrame& frame, const ImageMotion& image, GroundStatus status);
  bool isTiltKnown() const { return estimate.tilt_deviation <= options.max_tilt_deviation; }
  GroundStatus connect(const GroundFrame& frame, const ImageMotion& image);
  void compareImu(const GroundFrame& frame, const ImageMotion& image);
  CameraPose firstPose(const GroundFrame& frame) const;
  CameraPose onGround(const GroundFrame& frame, const CameraPose& pose) const;
  void predict(double seconds);
  void useReadings(const GroundFrame& frame);
  template <int kRows>
  double use(motion::PoseRows<kRows> rows, Innovations& of_kind, std::int64_t ground);
  void addTurn(const GroundFrame& frame);
  void useTurn(TurnReading turn, double seconds);
  double doubtOf(const Eigen::Vector3d& turn, double seconds);
  Eigen::Vector3d newestVelocity(double seconds) const;
  bool isJump(double seconds, double since_last) const;
  double largestChange(double seconds, double since_last) const;
  bool isBelieved(std::optional<Eigen::Vector3d> velocity);
  void widenForReadings(const GroundFrame& frame);
  void widenForSlope();
  void moveToDestination();
  void beginMap(const GroundFrame& frame, const ImageMotion& image);
  void measureTwist(double seconds, double since_last);
  void followLastVelocity(const Vector6& last, const Matrix6& last_covariance, double since_last);
  /// Over relief each keyframe sees a plane of its own, which slopes as the ground does there. All
  /// readings until the next keyframe contradict it together.
  std::int64_t seenSlope() const { return relief.isSeen() ? keyframe_stamp : newest_stamp; }
  double sinceLast(const GroundFrame& frame) const {
    return 1e-9 * static_cast<double>(frame.stamp - last_stamp);
  }

  GroundMotionOptions options;
  GroundFilter filter;
  GroundEstimate estimate;
  bool has_pose = false;      // of the frame at last_stamp
  bool is_connected = false;  // the map of the keyframe is valid
  std::int64_t last_stamp = 0;
  std::optional<TurnReading> turned;  // since that frame; empty: a reading was missing
  std::int64_t newest_stamp = 0;      // also of frames without a homography
  std::int64_t before_stamp = 0;      // of the frame before that
  bool has_frame = false;
  int looks_away = 0;  // normals that say so, one after the other
  std::int64_t keyframe_stamp = 0;
  Eigen::Vector3d keyframe_position = Eigen::Vector3d::Zero();
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // where lengths count from
  Vector6 camera_twist = Vector6::Zero();            // of the camera, in its frame
  Matrix6 camera_twist_covariance = Matrix6::Zero();
  motion::TwistNoise twist_noise;
  motion::Relief relief;
  motion::Shutter shutter;
  motion::Mounting mounting;
  Innovations of_homography;
  Innovations of_height;
  Innovations of_down;
  Innovations of_turn;
  double turn_given_and_seen = 0.0;  // sums of products, rad²
  double turn_seen = 0.0;
  Eigen::Vector3d rate = Eigen::Vector3d::Zero();  // of the newest turn, rad/s
  bool has_velocity = false;                       // measured since the last gap
  int contradictions = 0;                          // refused frames one after the other
  Refused refused;                                 // the newest of them
  std::optional<Destination> destination;
};

const GroundEstimate& GroundMotion::Impl::add(const GroundFrame& frame) {
  const std::optional<TurnReading> turns = std::exchange(turned, std::nullopt);
  motion::requireValid(frame);  // the turn of a frame that is refused is missing in the sum
  turned = turns;
  if (has_frame && frame.stamp == newest_stamp) {
    throw std::invalid_argument("the frame has the stamp of the previous one; expected a new one");
  }
  estimate = {};
  const bool went_back = has_frame && frame.stamp < newest_stamp;
  before_stamp = newest_stamp;
  newest_stamp = frame.stamp;
  has_frame = true;
  if (went_back) has_pose = is_connected = false;
  addTurn(frame);
  estimate.status = went_back ? GroundStatus::stamp_went_back : follow(frame);
  if (!filter.isFinite()) forget();
  mounting.endFrame();
  estimate.imu = mounting.estimate(options.camera_to_base.linear());
  estimate.readout_time = filter.readout();
  estimate.readout_deviation = filter.readoutDeviation();
  if (estimate.hasPose()) {
    last_stamp = frame.stamp;
    turned = TurnReading();
    const motion::CameraMotion camera{filter.pose(), filter.covariance(), camera_twist,
                                      camera_twist_covariance};
    motion::reportBase(camera, origin, options, estimate);
  } else if (estimate.status == GroundStatus::no_normal) {
    last_stamp = frame.stamp;
    turned = TurnReading();
  }
  return estimate;
}

/// A state that is not finite would stay so for ever: the next frame begins anew.
void GroundMotion::Impl::forget() {
  estimate = {};
  estimate.status = GroundStatus::not_finite;
  filter = {};
  setReadout();
  twist_noise = {};
  relief = {};
  shutter = {};
  mounting = {};
  refused = {};
  of_homography = of_height = of_down = of_turn = {};
  turn_given_and_seen = turn_seen = 0.0;
  rate.setZero();
  has_pose = is_connected = false;
}

void GroundMotion::Impl::setReadout() {
  constexpr double kShare = 0.1;  // of what was given
  const double known = std::max(options.readout_time, 0.0);
  filter.setReadout(known, options.readout_time < 0.0 ? util::kUnknownReadout : kShare * known);
}

GroundStatus GroundMotion::Impl::follow(const GroundFrame& frame) {
  const bool from_last = frame.reference_stamp == last_stamp;
  const bool is_connection = is_connected && (from_last || frame.reference_stamp == keyframe_stamp);
  const bool was_down = is_connection && looksDown(-filter.pose().axes.row(2).transpose());
  constexpr int kBelieved = 10;  // one after the other
  looks_away = frame.down && !looksDown(frame.down->direction) ? looks_away + 1 : 0;
  if (looks_away > (was_down ? kBelieved : 0)) return GroundStatus::looks_away;
  if (!frame.answer) return GroundStatus::no_homography;
  if (!motion::isUsable(frame.answer->covariance)) return GroundStatus::no_covariance;
  ImageMotion image =
      motion::inImageUnits(frame.answer->homography, frame.answer->covariance, frame.camera);
  // Over relief the misfit is that of the plane: the readings, which are widened, give way.
  if (!relief.isSeen()) image.covariance *= of_homography.factor();
  image.by_readout =
      shutter.add(image, frame.stamp, frame.reference_stamp, frame.size, frame.camera);
  if (is_connection) {
    if (from_last && frame.reference_stamp != keyframe_stamp) {
      filter.setKeyframe(image, true);
      widenForSlope();
      twist_noise.beginKeyframe();
      keyframe_stamp = frame.reference_stamp;
    }
    return connect(frame, image);
  }
  return beginAt(frame, image);
}

/// A pose for a frame that nothing connects to the frames before it.
GroundStatus GroundMotion::Impl::beginAt(const GroundFrame& frame, const ImageMotion& image) {
  if (has_pose) return resume(frame, image);
  if (!frame.height) return GroundStatus::no_height;
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
  camera_twist_covariance.diagonal().tail<3>().setConstant(std::pow(options.turn_acceleration, 2));
  widenForReadings(frame);
  useReadings(frame);
  return placed(frame, image, GroundStatus::started);
}

/// After a gap the last velocity leads to the reference, and the homography from there to the
/// frame. That is a velocity, too, where the reference is the frame just before.
GroundStatus GroundMotion::Impl::resume(const GroundFrame& frame, const ImageMotion& image) {
  const GroundFilter before = filter;
  estimate.gap = sinceLast(frame);
  const bool follows = frame.reference_stamp == before_stamp && before_stamp > last_stamp;
  const double seconds = 1e-9 * static_cast<double>(frame.stamp - before_stamp);
  predict(follows ? estimate.gap - seconds : estimate.gap);
  GroundFrame begin = frame;
  if (follows) {  // the readings at the reference, as far as the last velocity tells them
    const double doubt = seconds * estimate.gap;
    if (begin.height) {
      begin.height->age -= seconds;
      begin.height->deviation = std::hypot(begin.height->deviation, doubt * options.acceleration);
    }
    if (begin.down) {
      const Eigen::Matrix3d turn = frame.turn
                                       ? frame.turn->rotation
                                       : motion::rotationAbout(seconds * camera_twist.tail<3>());
      begin.down->direction = turn * begin.down->direction;
      if (!looksDown(begin.down->direction)) begin.down.reset();
    }
    if (begin.down) {
      begin.down->deviation = std::hypot(begin.down->deviation, doubt * options.turn_acceleration);
    }
  }
  widenForReadings(begin);
  useReadings(begin);
  if (!follows) return placed(frame, image, GroundStatus::resumed);
  filter.setKeyframe(image, true);
  const auto innovation = filter.advance(image);
  if (!innovation) estimate.homography_misfit = std::numeric_limits<double>::infinity();
  if (!innovation || (isJump(seconds, estimate.gap) && !isBelieved(newestVelocity(seconds)))) {
    filter = before;
    return GroundStatus::contradiction;
  }
  twist_noise.beginKeyframe();
  keyframe_stamp = frame.reference_stamp;
  keyframe_position = filter.pose().position;
  if (frame.turn) useTurn(*frame.turn, seconds);
  measureTwist(seconds, estimate.gap);
  if (destination) return placed(frame, image, GroundStatus::resumed);
  is_connected = true;
  return isTiltKnown() ? GroundStatus::resumed : GroundStatus::no_normal;
}

/// The reference of `image` becomes the keyframe of the newest pose, which no map has led to.
GroundStatus GroundMotion::Impl::placed(const GroundFrame& frame, const ImageMotion& image,
                                        GroundStatus status) {
  contradictions = 0;
  has_velocity = false;
  if (destination) moveToDestination();
  beginMap(frame, image);
  has_pose = is_connected = true;
  return isTiltKnown() ? status : GroundStatus::no_normal;
}

/// A pose from the homography to the keyframe.
GroundStatus GroundMotion::Impl::connect(const GroundFrame& frame, const ImageMotion& image) {
  const GroundFilter before = filter;
  const auto innovation = filter.advance(image);
  if (innovation) {
    estimate.homography_misfit = innovation->misfit;
    of_homography.add({innovation->misfit, of_homography.factor() * innovation->noise},
                      frame.stamp);
  } else {
    estimate.homography_misfit = std::numeric_limits<double>::infinity();
  }
  const bool fits = innovation && estimate.homography_misfit < kHomographyLimit;
  if (!fits || isJump(sinceLast(frame), sinceLast(frame))) {
    const bool is_believed = fits && isBelieved(std::nullopt);
    filter = before;
    if (is_believed || ++contradictions >= kPatience) is_connected = false;
    return GroundStatus::contradiction;
  }
  const Eigen::Vector3d& position = filter.now().position;
  relief.add(frame.answer->plane_deviation / frame.camera(0, 0),
             position.head<2>().norm() / position.z());
  contradictions = 0;
  compareImu(frame, image);
  if (turned) useTurn(*turned, sinceLast(frame));
  useReadings(frame);
  measureTwist(sinceLast(frame), sinceLast(frame));
  if (destination) {
    moveToDestination();
    beginMap(frame, image);
  }
  return isTiltKnown() ? GroundStatus::ok : GroundStatus::no_normal;
}

/// With the pictures as they are before they follow the readings.
void GroundMotion::Impl::compareImu(const GroundFrame& frame, const ImageMotion& image) {
  const bool has_down = frame.down && frame.down->of_imu && looksDown(frame.down->direction);
  if (!frame.turn && !has_down) return;
  const auto seen = filter.turnSinceKeyframe(image);
  if (seen)
    mounting.add(*seen, frame.reference_stamp, sinceLast(frame), frame.turn,
                 has_down ? frame.down : std::nullopt);
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

/// For a frame without a connection to earlier ones: height and tilt become unknown, so that the
/// readings alone determine them.
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

/// Uses a reading with the noise that readings of its kind have shown. Returns its misfit.
template <int kRows>
double GroundMotion::Impl::use(motion::PoseRows<kRows> rows, Innovations& of_kind,
                               std::int64_t ground) {
  const Innovation innovation = filter.innovationOf(rows);
  of_kind.add(innovation, ground);
  rows.deviation *= std::sqrt(of_kind.factor());
  filter.use(rows);
  return innovation.misfit;
}

void GroundMotion::Impl::useReadings(const GroundFrame& frame) {
  const double limit = GroundEstimate::kContradiction;
  if (frame.height) {
    const CameraPose now = filter.now();
    const double rise = now.axes.row(2).dot(camera_twist.head<3>());
    const motion::PoseRows<1> rows = rowsOf(relief.widened(*frame.height), now, rise);
    estimate.height_misfit = std::numeric_limits<double>::infinity();
    if (std::isfinite(rows.residual(0))) {
      estimate.height_misfit = use(rows, of_height, newest_stamp);
      filter.widen(of_height.doubt(rows.residual(0) / now.position.z(), 0), 0.0);
    }
    estimate.height_used = estimate.height_misfit <= limit;
  }
  if (frame.down && !looksDown(frame.down->direction)) {
    estimate.down_misfit = std::numeric_limits<double>::infinity();
  } else if (frame.down) {
    const motion::PoseRows<3> rows = rowsOf(relief.widened(*frame.down), filter.now());
    const double spread = of_down.spread();
    of_down.addResidual(rows.residual / rows.deviation);
    estimate.down_misfit = use(rows, of_down, seenSlope()) / spread;
    // The pictures tell the tilt as well: one reading alone does not count against them.
    filter.widen(0.0, of_down.doubt(rows.residual.norm(), 1));
    estimate.down_used = estimate.down_misfit <= limit;
  }
  const Eigen::Matrix3d& axes = filter.now().axes;
  const Eigen::Matrix3d turn =
      axes * filter.covariance().bottomRightCorner<3, 3>() * axes.transpose();
  estimate.tilt_deviation = std::sqrt(std::max(turn(0, 0), turn(1, 1)));
}

/// Readings are from frame to frame, and poses may be further apart.
void GroundMotion::Impl::addTurn(const GroundFrame& frame) {
  if (!frame.turn) turned.reset();
  if (!turned) return;
  turned->rotation = turned->rotation * frame.turn->rotation;
  turned->deviation = std::hypot(turned->deviation, frame.turn->deviation);
}

/// What a delay of the Imu and its mounting, where the pictures show them, add to the deviation of
/// a turn, rad.
double GroundMotion::Impl::doubtOf(const Eigen::Vector3d& turn, double seconds) {
  constexpr double kCertain = 3.0;  // deviations
  const Eigen::Vector3d newest = turn / seconds;
  const double change = (newest - std::exchange(rate, newest)).norm();
  const std::optional<ImuMounting> imu = mounting.estimate(options.camera_to_base.linear());
  if (!imu) return 0.0;
  const double delay = std::abs(imu->delay) > kCertain * imu->delay_deviation ? imu->delay : 0.0;
  const Eigen::Vector3d rotation =
      (imu->rotation.array().abs() > kCertain * imu->rotation_deviation.array())
          .select(imu->rotation, 0.0);
  return std::hypot(delay * change, rotation.cross(options.camera_to_base.linear() * turn).norm());
}

void GroundMotion::Impl::useTurn(TurnReading turn, double seconds) {
  const Eigen::Vector3d given = motion::turnOf(turn.rotation);
  turn.deviation = std::hypot(turn.deviation, doubtOf(given, seconds));
  const Eigen::Vector3d seen = motion::turnOf(filter.before().axes.transpose() * filter.now().axes);
  constexpr double kForget = 0.99;
  constexpr double kLeast = 1e-3;  // rad²
  turn_given_and_seen = kForget * turn_given_and_seen + given.dot(seen);
  turn_seen = kForget * turn_seen + seen.squaredNorm();
  estimate.turn_ratio = turn_seen > kLeast ? turn_given_and_seen / turn_seen : 0.0;
  estimate.turn_misfit = use(rowsOf(turn, filter.now(), filter.before()), of_turn, newest_stamp);
}

/// Of the camera in its frame, since the pose before.
Eigen::Vector3d GroundMotion::Impl::newestVelocity(double seconds) const {
  const CameraPose& before = filter.before();
  return before.axes.transpose() * (filter.now().position - before.position) / seconds;
}

/// How far velocities can be from each other: a vehicle accelerates, and what is below a pixel or
/// two is noise, which is metres from a large height.
double GroundMotion::Impl::largestChange(double seconds, double since_last) const {
  constexpr double kSpeed = 0.5;          // m/s
  constexpr double kPicture = 0.003;      // rad: a pixel or two
  constexpr double kAcceleration = 10.0;  // m/s²
  constexpr double kDeviations = 4.0;
  const double deviation = std::sqrt(camera_twist_covariance.topLeftCorner<3, 3>().trace());
  return std::max(kSpeed, kPicture * filter.now().position.z() / seconds) +
         kAcceleration * since_last + kDeviations * deviation;
}

/// Whether the newest pose is farther from where the last velocity leads than a vehicle can go: the
/// homography may be off by a period of repetitive ground.
bool GroundMotion::Impl::isJump(double seconds, double since_last) const {
  if (!has_velocity) return false;
  constexpr double kDeviations = 4.0;
  const double change = (newestVelocity(seconds) - camera_twist.head<3>()).norm();
  const double largest = largestChange(seconds, since_last);
  if (change < largest) return false;
  const motion::Matrix612 slope = motion::twistSlope(filter.before(), filter.now()) / seconds;
  const Matrix6 covariance = propagated(slope, filter.covarianceOfBoth());
  const double deviation = std::sqrt(covariance.topLeftCorner<3, 3>().trace());
  return !(change < largest + kDeviations * deviation);
}

/// Whether the newest pose, which is a jump, and the refused ones just before it are one motion.
/// Then the velocity before them is of no use any more. `velocity`: at the newest pose; empty: from
/// the last refused one.
bool GroundMotion::Impl::isBelieved(std::optional<Eigen::Vector3d> velocity) {
  constexpr int kFrames = 3;
  const double seconds = 1e-9 * static_cast<double>(newest_stamp - before_stamp);
  const CameraPose& now = filter.now();
  const bool follows = refused.stamp == before_stamp && refused.agree > 0;
  if (!velocity && follows && refused.keyframe_stamp == keyframe_stamp) {
    velocity = now.axes.transpose() * (now.position - refused.position) / seconds;
  }
  const bool agrees =
      follows && (!velocity || !refused.velocity ||
                  (*velocity - *refused.velocity).norm() < largestChange(seconds, seconds));
  refused = {newest_stamp, keyframe_stamp, now.position, velocity, agrees ? refused.agree + 1 : 1};
  if (refused.agree < kFrames) return false;
  refused = {};
  return true;
}

/// Process noise of height and tilt: the ground of the next keyframe may slope against this one's.
void GroundMotion::Impl::widenForSlope() {
  const Eigen::Vector3d position = filter.pose().position;
  const double share = (position - keyframe_position).norm() / position.z();
  const double variance = options.ground_slope * options.ground_slope * share;
  filter.widen(variance, variance);
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

void GroundMotion::Impl::measureTwist(double seconds, double since_last) {
  const Vector6 last = camera_twist;
  const Matrix6 last_covariance = camera_twist_covariance;
  const bool follows = std::exchange(has_velocity, true);
  estimate.has_twist = true;
  camera_twist = motion::constantTwist(filter.before(), filter.now()) / seconds;
  const motion::Matrix612 slope = motion::twistSlope(filter.before(), filter.now()) / seconds;
  camera_twist_covariance = propagated(slope, filter.covarianceOfBoth());
  const Matrix6 noise = propagated(slope, filter.noiseOfBoth());
  twist_noise.add(camera_twist, noise, seconds, filter.now().position.z());
  if (!relief.isSeen()) camera_twist_covariance -= noise - twist_noise.scaled(noise);
  if (follows) followLastVelocity(last, last_covariance, since_last);
}

/// A Kalman update by the last velocity, from which this one differs by an unknown acceleration. It
/// matters where the pictures tell less: near the ground few features are in view, and a rotation
/// looks like a translation.
void GroundMotion::Impl::followLastVelocity(const Vector6& last, const Matrix6& last_covariance,
                                            double since_last) {
  const Eigen::Matrix3d to_now = filter.now().axes.transpose() * filter.before().axes;
  const Eigen::Vector3d change = to_now * last.head<3>() - camera_twist.head<3>();
  Eigen::Matrix3d covariance = camera_twist_covariance.topLeftCorner<3, 3>();
  covariance += to_now * last_covariance.topLeftCorner<3, 3>() * to_now.transpose();
  covariance.diagonal().array() += std::pow(options.acceleration * since_last, 2);
  const Eigen::Matrix<double, 6, 3> gain =
      camera_twist_covariance.leftCols<3>() * covariance.inverse();
  camera_twist += gain * change;
  camera_twist_covariance -= gain * camera_twist_covariance.topRows<3>();
}

GroundMotion::GroundMotion(const GroundMotionOptions& options) : impl_(std::make_unique<Impl>()) {
  setOptions(options);
  impl_->setReadout();
}
GroundMotion::~GroundMotion() = default;
GroundMotion::GroundMotion(GroundMotion&&) noexcept = default;
GroundMotion& GroundMotion::operator=(GroundMotion&&) noexcept = default;

const GroundMotionOptions& GroundMotion::options() const {
  return impl_->options;
}

void GroundMotion::setOptions(const GroundMotionOptions& options) {
  motion::requireValid(options);
  const bool other_shutter = options.readout_time != impl_->options.readout_time;
  impl_->options = options;
  if (other_shutter) impl_->setReadout();
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
