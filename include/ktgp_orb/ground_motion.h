#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

using Twist6 = Eigen::Matrix<double, 6, 1, Eigen::DontAlign>;

/// A measurement of the height of the camera above the ground.
struct HeightReading {
  double metres = 0.0;  ///< > 0
  /// Standard deviation, m, >= 0; the errors of different readings are assumed to be independent.
  double deviation = 0.0;
  /// Age of the reading at the time of the image, s. GroundMotion corrects for it with the vertical
  /// velocity.
  double age = 0.0;
  /// For a range sensor: origin and direction (length 1) of its beam in the camera's frame. If the
  /// direction is zero, `metres` is the distance of the camera from the ground.
  Eigen::Vector3d beam_origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d beam_direction = Eigen::Vector3d::Zero();
};

/// A measurement of the direction from the camera to the ground, perpendicular to the ground.
struct DownReading {
  /// Direction in the camera's frame, length 1.
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();
  double deviation = 0.0;  ///< standard deviation about each axis, rad, >= 0
  bool of_imu = false;     ///< true if an Imu measured it; see GroundEstimate::imu
  double age = 0.0;        ///< age at the time of the image, s; used for GroundEstimate::imu
};

/// A measurement of the rotation since the previous frame, for example by a gyroscope.
struct TurnReading {
  /// Rotation from the camera's frame now to the camera's frame at the previous image.
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  double deviation = 0.0;  ///< standard deviation about each axis, rad, >= 0
  /// The gyroscope's time interval begins and ends this much earlier than the interval between the
  /// two images, s; used only for GroundEstimate::imu.
  double age = 0.0;
};

/// Returns a text that says what is wrong with a reading and what to do about it; empty if the
/// reading is usable.
std::string whyUnusable(const HeightReading& reading);
std::string whyUnusable(const DownReading& reading);
std::string whyUnusable(const TurnReading& reading);

/// A frame of the camera, as input of GroundMotion.
struct GroundFrame {
  std::int64_t stamp = 0;            ///< ns since any epoch
  std::int64_t reference_stamp = 0;  ///< stamp of the reference frame of the homography
  /// Homography reference -> this frame, in px of images without lens distortion; empty if none was
  /// found.
  std::optional<UncertainHomography> answer;
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();  ///< K, px
  cv::Size size;  ///< size of the image, px; if empty, a global shutter is assumed
  std::optional<HeightReading> height;
  std::optional<DownReading> down;
  std::optional<TurnReading> turn;
};

struct GroundMotionOptions {
  /// Mounting of the camera: transform from the camera's frame (x right, y down, z forward) to the
  /// vehicle's base frame. If the camera of a level base would look at the sky, as with the
  /// identity, and there is no DownReading, it is assumed to look straight down.
  Pose3 camera_to_base = Pose3::Identity();
  /// Standard deviation by which the slope of the ground changes over a flown distance as long as
  /// the height, >= 0; 0.01 means 1 m in 100 m. Since the slope may change, earlier readings of the
  /// height and the normal count less with each new keyframe, in proportion to the distance flown.
  double ground_slope = 0.002;
  /// Time from the exposure of the first row of an image to the exposure of the last row, s, -0.2
  /// to 0.2. 0: global shutter. Below 0: the last row is exposed first, for example because the
  /// driver rotates the images by 180 degrees. -1: not known. Unless the value is 0, GroundMotion
  /// estimates the time; a given time counts as right to 10 %.
  double readout_time = -1.0;
  /// Standard deviation of an error that scales all lengths by the same factor, >= 0; for example
  /// 0.05 if the height was measured only once, and that measurement may be off by 5 %.
  double scale_deviation = 0.0;
  /// Standard deviation of the acceleration, m/s², >= 0. Determines how much the velocity may
  /// change from one measurement to the next, and how fast the uncertainty grows during a gap, in
  /// which no frame can be connected to earlier frames.
  double acceleration = 5.0;
  /// Standard deviation of the angular acceleration, rad/s², >= 0; only used during a gap.
  double turn_acceleration = 2.0;
  /// Upper limit of the standard deviation of the ground's normal, rad, > 0. While the deviation is
  /// larger, no motion is reported.
  double max_tilt_deviation = 0.1;
};

/// State of the estimated motion after a frame.
enum class GroundStatus : std::uint8_t {
  ok = 0,       ///< pose and twist are known
  started = 1,  ///< the first frame: a pose without a twist
  /// The first frame after a gap: the pose has a larger covariance, and a twist is known only if
  /// the reference is the frame directly before this frame and has the readings (height, down) that
  /// this frame has.
  resumed = 2,
  no_homography = 3,  ///< no homography was found
  no_covariance = 4,  ///< the homography has no usable covariance, so it cannot be weighted
  no_height = 5,      ///< no usable height has been given yet
  /// No normal of the ground has been given (DownReading), and the motion does not determine it
  /// yet.
  no_normal = 6,
  /// The homography is not used, because it contradicts the map of the keyframe or implies a jump
  /// of the camera that no vehicle can make.
  contradiction = 7,
  /// The stamp is older than the previous frame's stamp. A single frame with an older stamp is left
  /// out. If the next frame continues from the older stamp, the recording was looped or a clock was
  /// set, and the motion begins anew.
  stamp_went_back = 8,
  not_finite = 9,  ///< numbers became too large to compute with; the motion begins anew
  /// The camera looks above the horizon or less than 5.7 degrees below it. Either more than ten
  /// DownReadings in a row say so, or one says so and the images do not contradict it.
  looks_away = 10,
};

/// Returns the enumerator's name, e.g. "no_height".
const char* toString(GroundStatus status);

/// Errors of the mounting, the stamps and the angular velocity of an Imu. GroundMotion estimates
/// them by comparing the Imu's readings with the rotation that the images show. Deviations are
/// standard deviations. If the motion does not determine a value, the value is 0 and its deviation
/// is infinite.
struct ImuMounting {
  /// Rotation from the stated mounting of the Imu to the true mounting, as a rotation vector in the
  /// base frame, rad. Errors of more than 0.35 rad are not found.
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation_deviation = Eigen::Vector3d::Zero();
  /// How much later the Imu's stamps are than the stamps of images taken at the same time, s.
  double delay = 0.0;
  double delay_deviation = 0.0;
  /// Bias of the angular velocity, in the base frame, rad/s. Subtract it from the Imu's values.
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d bias_deviation = Eigen::Vector3d::Zero();
  /// Relative error of the angular velocity; positive if the Imu's values are too large. A wrong
  /// focal length of the camera has the same effect, except for turns about the optical axis.
  double scale_error = 0.0;
  double scale_error_deviation = 0.0;
};

/// Returns all known errors as text, e.g. "mounted 0.1 +- 0.2 degrees off about x; stamps 1 +- 3 ms
/// late".
std::string describe(const ImuMounting& imu);
/// Returns the errors that are certain and large enough to matter, as text; empty if there are
/// none.
std::string troubleOf(const ImuMounting& imu);

/// Position and velocity of the vehicle's base.
struct GroundEstimate {
  GroundStatus status = GroundStatus::no_homography;
  /// Transform from the base frame to the odometry frame. In the odometry frame, the ground is the
  /// plane z = 0, and the z axis points up. At the start, the base is above the origin, and its x
  /// axis points along the frame's x axis.
  Pose3 base_to_odometry = Pose3::Identity();
  /// Covariance of x, y, z (m) and of small rotations about the axes of the odometry frame (rad).
  Covariance6 pose_covariance = Covariance6::Zero();
  /// Velocity (m/s) and angular velocity (rad/s) in the base frame. If they stay constant between
  /// the previous frame and this frame, they move the base from its previous pose to this pose.
  Twist6 twist = Twist6::Zero();
  Covariance6 twist_covariance = Covariance6::Zero();

  bool has_twist = false;  ///< see hasTwist()

  double height = 0.0;          ///< height of the camera above the ground, m
  double tilt_deviation = 0.0;  ///< standard deviation of the ground's normal about one axis, rad
  double gap = 0.0;             ///< for status resumed: time since the last frame with a pose, s
  /// Misfits, in standard deviations. The misfit of a reading is the difference between the reading
  /// and its prediction by the homography and the earlier readings. The misfit of the homography is
  /// the difference between the homography and its prediction by flat ground and the earlier
  /// readings. A reading with a misfit beyond kContradiction gets hardly any weight. For a
  /// DownReading, the standard deviation is the given deviation or, if these readings scatter more,
  /// their scatter (at most ten times the given deviation). A missing reading has a misfit of 0.
  double height_misfit = 0.0;
  double down_misfit = 0.0;
  double turn_misfit = 0.0;
  double homography_misfit = 0.0;
  static constexpr double kContradiction = 6.0;
  bool height_used = false;  ///< true if a height was given and its misfit is within kContradiction
  bool down_used = false;
  /// Ratio of the rotations in the TurnReadings to the rotations that the images show. 1 is
  /// expected. -1 means that the angular velocity has the wrong sign, and 57.3 means that it is in
  /// degrees. The value is 0 until the camera has turned enough.
  double turn_ratio = 0.0;
  /// Readout time of a rolling shutter, estimated from the images, and its standard deviation, s.
  /// If the time is negative, the last row is exposed first.
  double readout_time = 0.0;
  double readout_deviation = 0.0;
  /// Errors of the Imu that gives TurnReadings or DownReadings. They are only reported; no reading
  /// is corrected. It takes minutes to estimate them, and begins anew if the last 20 s contradict
  /// the estimate; empty until the motion determines at least one of the errors.
  std::optional<ImuMounting> imu;

  bool hasPose() const { return status <= GroundStatus::resumed; }
  bool hasTwist() const { return hasPose() && has_twist; }
};

/// For a calibrated camera that looks at flat ground: estimates its motion in metres from
/// homographies.
///
/// The image of a keyframe serves as a map of the ground. This map consists of the homography G
/// from the image to metres on the ground, and of the covariance of G. The homography H from the
/// keyframe to a frame then depends on the frame's pose: H ~ M(pose) G, where M maps metres on the
/// ground to pixels of the frame. (In textbooks this is R + t n'/d, with the rotation R, the
/// translation t, and the normal n and the distance d of the ground seen from the keyframe: Malis &
/// Vargas 2007; Hartley & Zisserman 2004, ch. 13.) The pose is fitted to H by weighted least
/// squares. A Kalman filter then estimates G and the poses of the newest two frames together, from
/// H and the readings, weighted by their covariances. In this way, G collects what all readings say
/// about the scale and the tilt. The next keyframe takes them over, so errors of single readings
/// average out. If there are no DownReadings, the normal of the ground is found from the motion.
///
/// More than half of the noise of H comes from the image of the keyframe and is common to all
/// homographies from that keyframe. Therefore this part of the noise is counted as an error of G.
///
/// An instance belongs to one thread at a time. After the first frames, no memory is allocated.
class GroundMotion {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit GroundMotion(const GroundMotionOptions& options = {});
  ~GroundMotion();
  GroundMotion(GroundMotion&&) noexcept;
  GroundMotion& operator=(GroundMotion&&) noexcept;

  const GroundMotionOptions& options() const;
  /// The new options apply from the next frame on. Throws like the constructor; in that case, the
  /// old options stay.
  void setOptions(const GroundMotionOptions& options);

  /// Adds the next frame. The reference is the previous frame or the reference of the previous
  /// frame (as in the modes of SequenceMatcher); with any other reference, the motion continues
  /// from the predicted pose, as after a gap. Throws std::invalid_argument for unusable readings, a
  /// K that no camera has, a frame that is its own reference, and a homography that is not finite,
  /// mirrors the image or moves the whole reference out of it; the frame is then left out. It also
  /// throws if a different frame has the stamp of the last frame; the motion then continues as
  /// after a gap. If the last frame itself is added again, the estimate stays the same.
  const GroundEstimate& add(const GroundFrame& frame);

  /// Restarts the odometry at its origin.
  void reset();
  /// Sets x, y and the yaw of the base in the odometry frame. This takes effect at the next frame
  /// that gets a pose. The height and the tilt stay as measured. Only the rows of x, y and yaw of
  /// the covariance are used. Throws std::invalid_argument for values that are not finite and for
  /// negative variances.
  void setPose(const Pose3& base_to_odometry, const Covariance6& covariance);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
