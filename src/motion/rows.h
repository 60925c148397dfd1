#pragma once

#include <Eigen/Core>

#include "ktgp_orb/ground_motion.h"
#include "motion/camera_pose.h"
#include "util/geometry.h"

namespace ktgp_orb::motion {

using util::entriesOf;
using Vector8 = Eigen::Matrix<double, 8, 1>;
using Matrix8 = Eigen::Matrix<double, 8, 8>;
using Matrix86 = Eigen::Matrix<double, 8, 6>;

/// A homography between images of focal length 1. The last entry is 1, and the covariance is for
/// the first eight entries, row by row.
struct ImageMotion {
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();
  Matrix8 covariance = Matrix8::Zero();
  /// Correction of the entries per second of readout time, computed by Shutter::add().
  Vector8 by_readout = Vector8::Zero();
};

/// Shares of the covariance of a homography, measured on rendered flights. The share kOfKeyframe is
/// due to the image of the keyframe, whose noise is the same for all later frames. The share
/// kOfFrame is due to the other image.
inline constexpr double kOfKeyframe = 0.6;
inline constexpr double kOfFrame = 0.4;

/// Converts a homography from pixels to focal length 1. `camera`: K. A variance of (1e-6)² is added
/// to each entry, so that no deviation is 0 for images without noise.
ImageMotion inImageUnits(const Eigen::Matrix3d& homography, const Covariance8& covariance,
                         const Eigen::Matrix3d& camera);

/// Jacobians of the entries of the homography h = imageFromGround(pose) * map. byPose(): with
/// respect to a step of the pose (see moved()). byMap(): with respect to the error E of the map, a
/// 3x3 matrix with E(2,2) = 0; with this error, `map` becomes map * (I + E), where I is the
/// identity.
Matrix86 byPose(const Eigen::Matrix3d& h, const Eigen::Matrix3d& map, const CameraPose& pose);
Matrix8 byMap(const Eigen::Matrix3d& h);

/// Jacobian of E (see byMap()) with respect to the entries of h: column i is the E that changes
/// entry i of h by 1 and no other entry, if h becomes h * (I + E).
Matrix8 mapFromEntries(const Eigen::Matrix3d& h);

/// A linearised measurement of the newest and the previous pose: residual ~ slope * step of the
/// newest pose + slope_before * step of the previous pose + noise with standard deviation
/// `deviation`.
template <int kRows>
struct PoseRows {
  Eigen::Matrix<double, kRows, 1> residual;
  Eigen::Matrix<double, kRows, 6> slope = Eigen::Matrix<double, kRows, 6>::Zero();
  Eigen::Matrix<double, kRows, 6> slope_before = Eigen::Matrix<double, kRows, 6>::Zero();
  double deviation = 0.0;
};

/// Returns true if the camera looks at least 5.7 degrees below the horizon. `down`: direction to
/// the ground, in the camera's frame.
bool looksDown(const Eigen::Vector3d& down);
/// Returns true if the beam of the range sensor meets the ground, or if the reading has no beam.
bool meetsGround(const HeightReading& reading, const Eigen::Vector3d& down);
bool meetsGround(const HeightReading& reading, const CameraPose& pose);
/// Linearises a reading of the height or the normal about `pose`. `rise`: vertical velocity, m/s.
/// The residual is infinite if the beam of a range sensor does not meet the ground.
PoseRows<1> rowsOf(const HeightReading& reading, const CameraPose& pose, double rise);
PoseRows<3> rowsOf(const DownReading& reading, const CameraPose& pose);

/// Returns `pose` with the height and the normal of the ground that the readings of `frame` give.
/// The camera is rotated as little as possible, and the base keeps x and y. `lever`: position of
/// the base in the camera's frame.
CameraPose onGround(const GroundFrame& frame, const CameraPose& pose, const Eigen::Vector3d& lever);
/// The first pose: the base is above the origin of the odometry frame, and their x axes point in
/// the same direction. `frame` must have a height.
CameraPose firstPose(const GroundFrame& frame, const Pose3& camera_to_base);

/// Linearises a reading of the rotation between the poses `before` and `pose`.
PoseRows<3> rowsOf(const TurnReading& reading, const CameraPose& pose, const CameraPose& before);

}  // namespace ktgp_orb::motion
