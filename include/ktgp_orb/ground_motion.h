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

/// How high the camera is above the ground.
struct HeightReading {
  double metres = 0.0;     ///< > 0
  double deviation = 0.0;  ///< standard deviation, m, >= 0; independent in each reading
  double age = 0.0;        ///< s before the image; the vertical velocity corrects for it
  /// For a range sensor: where its beam starts and its direction (length 1), in the camera's frame.
  /// Direction zero: `metres` is the distance of the camera from the ground.
  Eigen::Vector3d beam_origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d beam_direction = Eigen::Vector3d::Zero();
};

/// The direction to the ground, along its normal.
struct DownReading {
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  ///< in the camera's frame, length 1
  double deviation = 0.0;  ///< standard deviation about each axis, rad, >= 0
  bool of_imu = false;     ///< measured by an Imu; then see GroundEstimate::imu
  double age = 0.0;        ///< s before the image, for GroundEstimate::imu alone
};

/// The rotation since the previous frame, for example from a gyroscope.
struct TurnReading {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< camera now -> camera then
  double deviation = 0.0;  ///< standard deviation about each axis, rad, >= 0
  double age = 0.0;        ///< s before the time between the frames, for GroundEstimate::imu alone
};

/// The fault of a reading and the remedy, as text; empty: the reading is fine.
std::string whyUnusable(const HeightReading& reading);
std::string whyUnusable(const DownReading& reading);
std::string whyUnusable(const TurnReading& reading);

/// A frame of the camera.
struct GroundFrame {
  std::int64_t stamp = 0;            ///< ns since any epoch
  std::int64_t reference_stamp = 0;  ///< stamp of the frame that the homography starts from
  /// Reference -> this frame, px without lens distortion; empty: none was found.
  std::optional<UncertainHomography> answer;
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();  ///< K, px
  cv::Size size;  ///< size of the image, px; without it the shutter counts as a global one
  std::optional<HeightReading> height;
  std::optional<DownReading> down;
  std::optional<TurnReading> turn;
};

struct GroundMotionOptions {
  /// Where the camera is on the vehicle: its frame (x right, y down, z forward) -> base frame.
  Pose3 camera_to_base = Pose3::Identity();
  /// Standard deviation of the slope of the ground from one keyframe to the next, >= 0: 0.01 is 1 m
  /// in 100 m. Old readings of height and normal count less after each keyframe.
  double ground_slope = 0.002;
  /// Time from the exposure of the first row of an image to that of the last one, s; 0: all at
  /// once, a global shutter; between -1 and 0: the last row is the first, as in pictures that the
  /// driver turns by 180 degrees; -1: not known. It is estimated, except for 0.
  double readout_time = -1.0;
  /// Standard deviation of a constant relative error of all lengths, such as that of a height that
  /// was measured once, >= 0.
  double scale_deviation = 0.0;
  /// Standard deviation of the acceleration, m/s², >= 0: from one velocity to the next, and while
  /// no frame is connected; then also of the angular acceleration, rad/s², >= 0.
  double acceleration = 5.0;
  double turn_acceleration = 2.0;
  /// The motion is unknown until the normal is known better than this, rad, > 0.
  double max_tilt_deviation = 0.1;
};

/// State of the motion after a frame.
enum class GroundStatus : std::uint8_t {
  ok = 0,             ///< pose and twist
  started = 1,        ///< the first frame: a pose without a twist
  resumed = 2,        ///< the first frame after a gap: a pose with a larger covariance, and a twist
                      ///< only where the reference is the frame just before
  no_homography = 3,  ///< none was found
  no_covariance = 4,  ///< the homography has no usable covariance, so nothing can be weighted
  no_height = 5,      ///< no height was given yet
  no_normal = 6,      ///< the normal was not given, and the motion does not show it yet
  contradiction = 7,  ///< the homography is a jump after earlier frames, and is not used
  /// A single frame is left out. With the next one that goes back, too, everything begins anew: a
  /// looped recording, or a clock that was set.
  stamp_went_back = 8,
  not_finite = 9,  ///< numbers too large to compute with: everything begins anew
  /// The camera looks above the horizon: normals say so again and again, or no picture contradicts
  /// one.
  looks_away = 10,
};

/// The enumerator's own name, e.g. "no_height".
const char* toString(GroundStatus status);

/// Errors of the mounting, the stamps and the angular velocity of an Imu, by the difference of its
/// readings from the rotation that the pictures show. Deviations are standard deviations; a value
/// that the motion does not show is 0, with an infinite deviation.
struct ImuMounting {
  /// Rotation from the stated mounting of the Imu to the true one: a turn about the axes of the
  /// base by its length, rad. Not found beyond 0.35 rad.
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation_deviation = Eigen::Vector3d::Zero();
  /// How much later its stamps are than those of images of the same time, s.
  double delay = 0.0;
  double delay_deviation = 0.0;
  /// Bias of the angular velocity, in the base frame, rad/s; subtract it.
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d bias_deviation = Eigen::Vector3d::Zero();
  /// Relative error of the angular velocity; above 0, it is too large. A wrong focal length of the
  /// camera looks like it, but about the optical axis.
  double scale_error = 0.0;
  double scale_error_deviation = 0.0;
};

/// All that is known, e.g. "mounting x 0.1 +- 0.2 degrees, stamps 1 +- 3 ms late".
std::string describe(const ImuMounting& imu);
/// The errors that are certain and large enough to matter, as text; empty: none.
std::string troubleOf(const ImuMounting& imu);

/// Position and velocity of the vehicle's base.
struct GroundEstimate {
  GroundStatus status = GroundStatus::no_homography;
  /// Base -> odometry frame. Its ground is z = 0, z points up. Where the odometry starts, the base
  /// is above the origin and its x axis points along x.
  Pose3 base_to_odometry = Pose3::Identity();
  /// Covariance of x, y, z (m) and of small rotations about the axes of the odometry frame (rad).
  Covariance6 pose_covariance = Covariance6::Zero();
  /// Velocity (m/s) and angular velocity (rad/s) in the base frame: the constant ones that move the
  /// base from its pose at the previous frame to this one.
  Twist6 twist = Twist6::Zero();
  Covariance6 twist_covariance = Covariance6::Zero();

  bool has_twist = false;  ///< see hasTwist()

  double height = 0.0;          ///< camera above the ground, m
  double tilt_deviation = 0.0;  ///< standard deviation of the normal about one axis, rad
  double gap = 0.0;             ///< s without connection, before a frame with status resumed
  /// Misfits in standard deviations: of a given reading, from the prediction by the homography and
  /// the earlier readings; of the homography, from the prediction by flat ground and these
  /// readings. Beyond kContradiction a reading hardly counts. The deviation of a normal is the
  /// given one, or the scatter of the normals, if that is more (up to ten times). 0: not given.
  double height_misfit = 0.0;
  double down_misfit = 0.0;
  double turn_misfit = 0.0;
  double homography_misfit = 0.0;
  static constexpr double kContradiction = 6.0;
  bool height_used = false;  ///< given, and its misfit is within kContradiction
  bool down_used = false;
  /// The given turns divided by those that the pictures show: 1 is expected, -1: an
  /// angular velocity that counts the other way, 57.3: in degrees. 0: too little was seen.
  double turn_ratio = 0.0;
  /// The readout time of a rolling shutter, as far as the pictures show it, and its standard
  /// deviation, s. Below 0: the last row is exposed first.
  double readout_time = 0.0;
  double readout_deviation = 0.0;
  /// Mounting of the Imu that gives turns or directions; nothing is corrected by it. Learned over
  /// minutes, empty before the motion shows anything.
  std::optional<ImuMounting> imu;

  bool hasPose() const { return status <= GroundStatus::resumed; }
  bool hasTwist() const { return hasPose() && has_twist; }
};

/// Metric motion of a calibrated camera that looks at flat ground, from homographies.
///
/// A keyframe is a map of the ground: the homography G from its image to metres on the ground, with
/// its covariance. The homography H from the keyframe to a frame is then that of the frame's pose,
/// H ~ M(pose) G, which is R + t n'/d for the plane seen from the keyframe (Malis & Vargas 2007;
/// Hartley & Zisserman 2004, ch. 13). The most likely pose is found by Gauss-Newton over the six
/// parameters of the pose, together with those of G and of the previous pose. H and the readings
/// are weighted by their covariances. The scale and the tilt from the readings stay in G and pass
/// from keyframe to keyframe, so errors of single readings average out. A normal that is not given
/// follows from the motion.
///
/// A good half of the noise of H comes from the image of the keyframe, and is the same in all
/// homographies from it. It belongs to G.
///
/// An instance belongs to one thread at a time. In the steady state nothing is allocated.
class GroundMotion {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit GroundMotion(const GroundMotionOptions& options = {});
  ~GroundMotion();
  GroundMotion(GroundMotion&&) noexcept;
  GroundMotion& operator=(GroundMotion&&) noexcept;

  const GroundMotionOptions& options() const;
  /// Applies from the next frame on. Throws as the constructor does, without any change.
  void setOptions(const GroundMotionOptions& options);

  /// Adds the next frame. The reference is the previous frame or the reference of the previous
  /// frame (as in the modes of SequenceMatcher); after any other one the motion begins anew at the
  /// predicted position. Throws std::invalid_argument, without any change, for unusable readings, a
  /// camera without focal length and a homography that is not finite; and for another frame with
  /// the stamp of the last one, after which the motion goes on as after a gap. The same frame again
  /// gets the same estimate.
  const GroundEstimate& add(const GroundFrame& frame);

  /// The odometry begins anew at its origin.
  void reset();
  /// Sets x, y and the yaw of the base in the odometry frame at the next frame; the height and the
  /// tilt stay as measured. Of the covariance these rows are used. Throws std::invalid_argument for
  /// values that are not finite.
  void setPose(const Pose3& base_to_odometry, const Covariance6& covariance);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
