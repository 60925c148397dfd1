#include "ktgp_orb/ground_motion.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "motion/ground_filter.h"
#include "motion/mounting.h"
#include "motion/noise.h"
#include "motion/shutter.h"
#include "motion/validity.h"
#include "motion/velocity.h"
#include "util/stamp_order.h"

namespace ktgp_orb {
namespace {

using motion::CameraPose;
using motion::GroundFilter;
using motion::ImageMotion;
using motion::Innovations;
using motion::looksDown;
using motion::Matrix6;

// Largest accepted misfit of a homography, in standard deviations.
constexpr double kHomographyLimit = 10.0;
constexpr int kPatience = 10;          // after this many refused frames, continue as after a gap
constexpr double kUnknownTilt = 0.35;  // rad; standard deviation of a tilt that is not known yet
// Standard deviation of x, y (as a share of the height) and yaw (rad) of the first pose.
constexpr double kOrigin = 1e-6;

/// The readings of a frame that depend on its own pose only.
struct Readings {
  std::optional<HeightReading> height;
  std::optional<DownReading> down;
};

}  // namespace

// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): in the order of use
struct GroundMotion::Impl {
  const GroundEstimate& add(const GroundFrame& frame);
  bool goesBack(const GroundFrame& frame);
  void forget();
  GroundStatus follow(const GroundFrame& frame);
  GroundStatus place(const GroundFrame& frame, const ImageMotion& image, bool is_connection);
  GroundStatus beginAt(const GroundFrame& frame, const ImageMotion& image);
  GroundStatus resume(const GroundFrame& frame, const ImageMotion& image);
  GroundStatus placed(const GroundFrame& frame, const ImageMotion& image, GroundStatus status);
  void setOrigin() {
    origin = filter.pose().position;
    origin.z() = 0.0;
  }
  bool isTiltKnown() const { return estimate.tilt_deviation <= options.max_tilt_deviation; }
  GroundStatus connect(const GroundFrame& frame, const ImageMotion& image);
  void compareImu(const GroundFrame& frame, const ImageMotion& image);
  void useReadings(const GroundFrame& frame);
  void addTurn(const GroundFrame& frame);
  void useTurn(TurnReading turn, double seconds);
  void widenForReadings(const GroundFrame& frame);
  void beginMap(const GroundFrame& frame, const ImageMotion& image);
  void beginKeyframe(const GroundFrame& frame);
  /// Identifies the ground below the camera for the innovations of the DownReadings, because
  /// Innovations::add counts contradictions on the same ground only once. Over relief, the plane
  /// that a keyframe shows has a slope of its own, so all readings until the next keyframe count as
  /// the same ground. Otherwise each frame counts as new ground.
  std::int64_t seenSlope() const { return relief.isSeen() ? keyframe_stamp : newest_stamp; }
  double sinceLast(const GroundFrame& frame) const {
    return 1e-9 * static_cast<double>(frame.stamp - last_stamp);
  }
  /// Returns true if the time since the last pose is known. It is unknown if `frame` has an earlier
  /// stamp than the last pose: then the stamp of the last pose was ahead of its time.
  bool knowsTime(const GroundFrame& frame) const { return frame.stamp > last_stamp; }

  GroundMotionOptions options;
  GroundFilter filter;
  GroundEstimate estimate;
  bool has_pose = false;      // true if the frame at last_stamp has a pose
  bool is_connected = false;  // true if the map of the keyframe is valid
  std::int64_t last_stamp = 0;
  std::optional<TurnReading> turned;  // rotation since last_stamp; empty if a reading was missing
  std::int64_t newest_stamp = 0;      // stamp of the newest frame, with or without a homography
  std::optional<Eigen::Matrix3d> newest_homography;
  std::int64_t before_stamp = 0;  // stamp of the frame before newest_stamp
  Readings newest;                // of the frame at newest_stamp
  Readings before;                // of the frame at before_stamp
  bool has_frame = false;
  util::StampOrder order;  // finds wrong stamps
  int looks_away = 0;      // number of successive DownReadings that point above the horizon
  std::int64_t keyframe_stamp = 0;
  Eigen::Vector3d keyframe_position = Eigen::Vector3d::Zero();
  // The point on the ground below the camera at the start, or at the last pose given to setPose().
  // A scale error (scale_deviation) has no effect here; its effect grows with the distance from
  // this point.
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  motion::Velocity velocity;
  motion::Relief relief;
  motion::Shutter shutter;
  motion::Mounting mounting;
  Innovations of_homography;
  Innovations of_height;
  Innovations of_down;
  Innovations of_turn;
  // Sums over the frames, in which older frames count less. turn_given_and_seen: scalar product of
  // the rotation vectors of the gyroscope and of the images, rad². turn_seen: squared length of the
  // rotation vector of the images, rad².
  double turn_given_and_seen = 0.0;
  double turn_seen = 0.0;
  // Angular velocity of the newest TurnReading, rad/s.
  Eigen::Vector3d rate = Eigen::Vector3d::Zero();
  int contradictions = 0;  // number of successive refused frames
  // The pose that setPose() asked for; empty after the base has been moved there.
  std::optional<Pose3> destination;
  Covariance6 destination_covariance = Covariance6::Zero();
};

const GroundEstimate& GroundMotion::Impl::add(const GroundFrame& frame) {
  const std::optional<TurnReading> turns = std::exchange(turned, std::nullopt);
  // If requireValid() throws, `turned` stays empty: without the rotation of this frame, the sum of
  // rotations since the last pose is not known.
  motion::requireValid(frame);
  turned = turns;
  const std::optional<Eigen::Matrix3d> homography =
      frame.answer ? std::make_optional(frame.answer->homography) : std::nullopt;
  if (has_frame && frame.stamp == newest_stamp) {
    if (homography == newest_homography) return estimate;  // the caller has added this frame before
    is_connected = false;  // the next frame may refer to this frame, whose pose is unknown
    throw std::invalid_argument("the frame has the stamp of the previous one; expected a new one");
  }
  estimate = {};
  if (goesBack(frame)) return estimate;
  before_stamp = newest_stamp;
  before = newest;
  newest_stamp = frame.stamp;
  newest = {frame.height, frame.down};
  filter.allowReadout(
      1e-9 * static_cast<double>(frame.stamp - (has_frame ? before_stamp : frame.reference_stamp)));
  newest_homography = homography;
  has_frame = true;
  addTurn(frame);
  estimate.status = follow(frame);
  if (estimate.hasTwist()) filter.limitReadout();
  if (!filter.isFinite()) forget();
  mounting.endFrame();
  estimate.imu = mounting.estimate(options.camera_to_base.linear());
  estimate.readout_time = filter.readout();
  estimate.readout_deviation = filter.readoutDeviation();
  if (estimate.hasPose()) filter.report(origin, options, estimate);
  if (estimate.hasTwist()) velocity.report(options, estimate);
  if (estimate.hasPose() || estimate.status == GroundStatus::no_normal) {
    last_stamp = frame.stamp;
    turned = TurnReading();
  }
  return estimate;
}

/// Returns true if the frame must be left out because its stamp is older than the previous one; see
/// StampOrder. A frame without a homography gives no pose, so a stamp that is too late does no
/// harm, and StampOrder only checks such a frame if its stamp is older than the previous one.
bool GroundMotion::Impl::goesBack(const GroundFrame& frame) {
  if (!frame.answer && !order.isBehind(frame.stamp)) return false;
  const util::StampOrder::Place place = order.next(frame.stamp);
  if (place.restarted) has_pose = is_connected = false;
  // The newest accepted stamp was too late, so the last velocity is based on a wrong duration.
  if (place.was_one_ahead) velocity.interrupt();
  if (place.restarted || place.was_one_ahead) {
    newest_stamp = *order.before();
    newest = {};  // the frame at this stamp was left out
  }
  if (place.is_apart) estimate.status = GroundStatus::stamp_went_back;
  return place.is_apart;
}

/// Clears the state after it became infinite or NaN, because it would never recover. The estimation
/// starts again with the next frame.
void GroundMotion::Impl::forget() {
  estimate = {};
  estimate.status = GroundStatus::not_finite;
  filter = {};
  filter.setReadout(options.readout_time);
  velocity = {};
  relief = {};
  shutter = {};
  mounting = {};
  of_homography = of_height = of_down = of_turn = {};
  turn_given_and_seen = turn_seen = 0.0;
  rate.setZero();
  has_pose = is_connected = false;
}

GroundStatus GroundMotion::Impl::follow(const GroundFrame& frame) {
  const bool is_connection = is_connected && (frame.reference_stamp == last_stamp ||
                                              frame.reference_stamp == keyframe_stamp);
  const bool was_down = is_connection && looksDown(-filter.pose().axes.row(2).transpose());
  constexpr int kBelieved = 10;  // number of successive upward DownReadings that are ignored
  looks_away = frame.down && !looksDown(frame.down->direction) ? looks_away + 1 : 0;
  if (looks_away > (was_down ? kBelieved : 0)) return GroundStatus::looks_away;
  if (!frame.answer) return GroundStatus::no_homography;
  if (!motion::isUsable(frame.answer->covariance)) return GroundStatus::no_covariance;
  ImageMotion image =
      motion::inImageUnits(frame.answer->homography, frame.answer->covariance, frame.camera);
  // Over relief, homographies fit badly because the ground is not a plane; they are not noisier
  // than elsewhere. So the noise of the readings is enlarged instead, see Relief::widened.
  if (!relief.isSeen()) image.covariance *= of_homography.factor();
  const motion::Shutter shutter_before = shutter;
  image.by_readout =
      shutter.add(image, frame.stamp, frame.reference_stamp, frame.size, frame.camera);
  const GroundStatus status = place(frame, image, is_connection);
  // The flow of a refused homography is as wrong as the homography.
  if (status == GroundStatus::contradiction) shutter = shutter_before;
  return status;
}

/// Finds the pose of a frame with a usable homography. `is_connection`: true if the reference is
/// the last frame or the keyframe.
GroundStatus GroundMotion::Impl::place(const GroundFrame& frame, const ImageMotion& image,
                                       bool is_connection) {
  if (!is_connection) return beginAt(frame, image);
  if (frame.reference_stamp == last_stamp && frame.reference_stamp != keyframe_stamp) {
    filter.setKeyframe(image, true);
    // The slope of the ground may change between keyframes, so the height and the tilt become
    // less certain; their variance grows in proportion to the distance flown.
    const Eigen::Vector3d position = filter.pose().position;
    const double share = (position - keyframe_position).norm() / position.z();
    const double variance = options.ground_slope * options.ground_slope * share;
    filter.widen(variance, variance);
    beginKeyframe(frame);
  }
  return connect(frame, image);
}

/// Finds a pose for a frame that is not connected to earlier frames.
GroundStatus GroundMotion::Impl::beginAt(const GroundFrame& frame, const ImageMotion& image) {
  if (has_pose) return resume(frame, image);
  if (!frame.height) return GroundStatus::no_height;
  const CameraPose first = motion::firstPose(frame, options.camera_to_base);
  if (!meetsGround(*frame.height, first)) {
    estimate.height_misfit = std::numeric_limits<double>::infinity();
    return GroundStatus::no_height;
  }
  motion::Vector6 variances;
  const double exact = kOrigin * frame.height->metres;
  variances << exact * exact, exact * exact, 0.0, 0.0, 0.0, kOrigin * kOrigin;
  Matrix6 covariance = variances.asDiagonal();
  covariance.bottomRightCorner<3, 3>() =
      first.axes.transpose() * covariance.bottomRightCorner<3, 3>() * first.axes;
  filter.start(first, covariance);
  setOrigin();
  velocity.start(options);
  widenForReadings(frame);
  useReadings(frame);
  return placed(frame, image, GroundStatus::started);
}

/// Continues after a gap: predicts the pose of `frame` from the last velocity. If the reference of
/// `frame` is the previous frame and has readings, too, predicts the pose of that reference
/// instead. The homography then gives the pose of `frame`, and the two poses give a velocity.
GroundStatus GroundMotion::Impl::resume(const GroundFrame& frame, const ImageMotion& image) {
  const GroundFilter filter_before = filter;
  estimate.gap = std::max(0.0, sinceLast(frame));
  // The reference must have readings of its own. With the readings of this frame alone, the
  // uncertain motion in between would leave the height and the tilt so uncertain that the next
  // readings correct them far beyond the range of the linearisation, and the covariance would not
  // include this error.
  if (before.down && !looksDown(before.down->direction)) before.down.reset();
  const bool has_readings = (!frame.height || before.height) && (!frame.down || before.down);
  const bool follows = frame.reference_stamp == before_stamp && before_stamp > last_stamp &&
                       frame.stamp > before_stamp && has_readings;
  const double seconds = 1e-9 * static_cast<double>(frame.stamp - before_stamp);
  filter.predict(velocity.twist(), velocity.covariance(),
                 follows ? estimate.gap - seconds : estimate.gap, options);
  GroundFrame begin = frame;
  if (follows) {
    begin.height = before.height;
    begin.down = before.down;
  }
  widenForReadings(begin);
  useReadings(begin);
  if (!follows) {
    velocity.coast(estimate.gap, options);
    return placed(frame, image, GroundStatus::resumed);
  }
  filter.setKeyframe(image, true);
  const auto innovation = filter.advance(image);
  if (!innovation) estimate.homography_misfit = std::numeric_limits<double>::infinity();
  if (!innovation ||
      (velocity.isJump(filter, seconds, estimate.gap) &&
       !velocity.isBelieved(filter, newest_stamp, before_stamp, keyframe_stamp, true))) {
    filter = filter_before;
    return GroundStatus::contradiction;
  }
  beginKeyframe(frame);
  if (frame.turn) useTurn(*frame.turn, seconds);
  velocity.measure(filter, seconds, estimate.gap, options.acceleration, !relief.isSeen());
  estimate.has_twist = true;
  if (destination) return placed(frame, image, GroundStatus::resumed);
  is_connected = true;
  return isTiltKnown() ? GroundStatus::resumed : GroundStatus::no_normal;
}

/// The last step of beginAt() and resume(): makes the reference of `image` the keyframe and
/// connects the next frames to it. Returns `status`, or no_normal if the tilt is not known.
GroundStatus GroundMotion::Impl::placed(const GroundFrame& frame, const ImageMotion& image,
                                        GroundStatus status) {
  contradictions = 0;
  velocity.interrupt();
  beginMap(frame, image);
  has_pose = is_connected = true;
  return isTiltKnown() ? status : GroundStatus::no_normal;
}

GroundStatus GroundMotion::Impl::connect(const GroundFrame& frame, const ImageMotion& image) {
  const GroundFilter filter_before = filter;
  const auto innovation = filter.advance(image);
  estimate.homography_misfit =
      innovation ? innovation->misfit : std::numeric_limits<double>::infinity();
  if (innovation) {
    of_homography.add({innovation->misfit, of_homography.factor() * innovation->noise},
                      frame.stamp);
  }
  const bool fits = innovation && estimate.homography_misfit < kHomographyLimit;
  const bool has_time = knowsTime(frame);
  if (!fits || (has_time && velocity.isJump(filter, sinceLast(frame), sinceLast(frame)))) {
    const bool is_believed =
        fits && velocity.isBelieved(filter, newest_stamp, before_stamp, keyframe_stamp, false);
    filter = filter_before;
    if (is_believed || ++contradictions >= kPatience) is_connected = false;
    return GroundStatus::contradiction;
  }
  const Eigen::Vector3d& position = filter.now().position;
  relief.add(frame.answer->plane_deviation / frame.camera(0, 0),
             position.head<2>().norm() / position.z());
  contradictions = 0;
  if (has_time) compareImu(frame, image);
  if (has_time && turned) useTurn(*turned, sinceLast(frame));
  useReadings(frame);
  if (has_time) {
    velocity.measure(filter, sinceLast(frame), sinceLast(frame), options.acceleration,
                     !relief.isSeen());
  }
  estimate.has_twist = has_time;
  if (destination) beginMap(frame, image);
  return isTiltKnown() ? GroundStatus::ok : GroundStatus::no_normal;
}

/// Compares the Imu's readings with the rotation that the images show. Call this before the
/// readings correct the filter, so that they do not influence this rotation.
void GroundMotion::Impl::compareImu(const GroundFrame& frame, const ImageMotion& image) {
  const bool has_down = frame.down && frame.down->of_imu && looksDown(frame.down->direction);
  if (!frame.turn && !has_down) return;
  const auto seen = filter.turnSinceKeyframe(image);
  if (seen)
    mounting.add(*seen, frame.reference_stamp, sinceLast(frame), frame.turn,
                 has_down ? frame.down : std::nullopt);
}

/// Call this for a frame that is not connected to earlier frames. If the frame has a reading of the
/// height or the normal, moves the pose to it and makes the height or the tilt nearly unknown, so
/// that only the reading determines it. The first pose gets an unknown tilt even without a reading.
void GroundMotion::Impl::widenForReadings(const GroundFrame& frame) {
  const CameraPose placed =
      onGround(frame, filter.pose(), options.camera_to_base.inverse().translation());
  Matrix6 more = Matrix6::Zero();
  if (frame.height && meetsGround(*frame.height, placed)) {
    more(2, 2) = frame.height->metres * frame.height->metres;
  }
  if (frame.down || !has_pose) {
    const Eigen::Vector3d level(1.0, 1.0, 0.0);
    more.bottomRightCorner<3, 3>() =
        kUnknownTilt * kUnknownTilt * (placed.axes.transpose() * level.asDiagonal() * placed.axes);
  }
  // The covariance of the rotation is about the axes of the camera.
  Matrix6 to_placed = Matrix6::Identity();
  to_placed.bottomRightCorner<3, 3>() = placed.axes.transpose() * filter.pose().axes;
  filter.start(placed, util::propagated(to_placed, filter.covariance()) + more);
}

void GroundMotion::Impl::useReadings(const GroundFrame& frame) {
  if (frame.height) {
    const CameraPose now = filter.now();
    const double rise = now.axes.row(2).dot(velocity.twist().head<3>());
    const motion::PoseRows<1> rows = rowsOf(relief.widened(*frame.height), now, rise);
    estimate.height_misfit = std::numeric_limits<double>::infinity();
    if (std::isfinite(rows.residual(0))) {
      estimate.height_misfit = filter.use(rows, of_height, newest_stamp);
      filter.widen(of_height.doubt(rows.residual(0) / now.position.z(), 0), 0.0);
    }
    estimate.height_used = estimate.height_misfit <= GroundEstimate::kContradiction;
  }
  if (frame.down && !looksDown(frame.down->direction)) {
    estimate.down_misfit = std::numeric_limits<double>::infinity();
  } else if (frame.down) {
    const motion::PoseRows<3> rows = rowsOf(relief.widened(*frame.down), filter.now());
    const double spread = of_down.spread();
    of_down.addResidual(rows.residual / rows.deviation);
    estimate.down_misfit = filter.use(rows, of_down, seenSlope()) / spread;
    // The images show the tilt, too. So the first reading that contradicts them does not make the
    // tilt less certain.
    filter.widen(0.0, of_down.doubt(rows.residual.norm(), 1));
    estimate.down_used = estimate.down_misfit <= GroundEstimate::kContradiction;
  }
  estimate.tilt_deviation = filter.tiltDeviation();
}

/// Adds the TurnReading of `frame` to the rotation since the last pose, because the next pose may
/// come several frames later.
void GroundMotion::Impl::addTurn(const GroundFrame& frame) {
  if (!frame.turn) turned.reset();
  if (!turned) return;
  turned->rotation = turned->rotation * frame.turn->rotation;
  turned->deviation = std::hypot(turned->deviation, frame.turn->deviation);
}

void GroundMotion::Impl::useTurn(TurnReading turn, double seconds) {
  const Eigen::Vector3d given = motion::turnOf(turn.rotation);
  const Eigen::Vector3d rate_before = std::exchange(rate, given / seconds);
  turn.deviation = std::hypot(turn.deviation, mounting.doubtOf(given, (rate - rate_before).norm(),
                                                               options.camera_to_base.linear()));
  const Eigen::Vector3d seen = motion::turnOf(filter.before().axes.transpose() * filter.now().axes);
  constexpr double kForget = 0.99;
  constexpr double kLeast = 1e-3;  // rad²
  turn_given_and_seen = kForget * turn_given_and_seen + given.dot(seen);
  turn_seen = kForget * turn_seen + seen.squaredNorm();
  estimate.turn_ratio = turn_seen > kLeast ? turn_given_and_seen / turn_seen : 0.0;
  estimate.turn_misfit =
      filter.use(rowsOf(turn, filter.now(), filter.before()), of_turn, newest_stamp);
}

/// Moves the base to the pose that setPose() asked for, if there is one. Then makes the reference
/// of `image` the keyframe. `image`: homography from this reference to the newest frame.
void GroundMotion::Impl::beginMap(const GroundFrame& frame, const ImageMotion& image) {
  if (destination) {
    filter.moveBase(*destination, destination_covariance, options.camera_to_base.inverse());
    setOrigin();
    destination.reset();
  }
  filter.setKeyframe(image, false);
  beginKeyframe(frame);
}

/// Call this when the reference of `frame` has become the filter's keyframe.
void GroundMotion::Impl::beginKeyframe(const GroundFrame& frame) {
  velocity.beginKeyframe();
  keyframe_stamp = frame.reference_stamp;
  keyframe_position = filter.pose().position;
}

GroundMotion::GroundMotion(const GroundMotionOptions& options) : impl_(std::make_unique<Impl>()) {
  setOptions(options);
  impl_->filter.setReadout(options.readout_time);
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
  if (other_shutter) impl_->filter.setReadout(options.readout_time);
}

const GroundEstimate& GroundMotion::add(const GroundFrame& frame) {
  return impl_->add(frame);
}

void GroundMotion::reset() {
  impl_->has_pose = impl_->is_connected = impl_->has_frame = false;
  impl_->order = {};
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
  impl_->destination = base_to_odometry;
  impl_->destination_covariance = covariance;
  impl_->destination_covariance.diagonal().array() += kOrigin * kOrigin;
}

}  // namespace ktgp_orb
