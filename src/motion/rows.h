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

/// A homography between images of focal length 1, with the covariance of its first eight entries,
/// row by row; the last one is 1.
struct ImageMotion {
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();
  Matrix8 covariance = Matrix8::Zero();
  /// Change of the entries per second of readout time, see Shutter.
  Vector8 by_readout = Vector8::Zero();
};

/// The shares of that covariance that belong to the image of the keyframe, the same for all frames
/// after it, and to the other image. Measured on exact flights.
inline constexpr double kOfKeyframe = 0.6;
inline constexpr double kOfFrame = 0.4;

/// Converts from pixels; `camera`: K. A deviation of 1e-6 is added to that of each entry, so that
/// none is 0 for pictures without noise.
ImageMotion inImageUnits(const Eigen::Matrix3d& homography, const Covariance8& covariance,
                         const Eigen::Matrix3d& camera);

/// Derivatives of the entries of h = M(pose) map by a step of the pose (see moved), and by E in
/// map (I + E), E(2,2) = 0.
Matrix86 byPose(const Eigen::Matrix3d& h, const Eigen::Matrix3d& map, const CameraPose& pose);
Matrix8 byMap(const Eigen::Matrix3d& h);

/// E for which h (I + E) has other entries by one.
Matrix8 mapFromEntries(const Eigen::Matrix3d& h);

/// A linearised measurement of the newest pose, and of the one before: residual ~ slope * step +
/// slope_before * step of the pose before + noise of the given deviation.
template <int kRows>
struct PoseRows {
  Eigen::Matrix<double, kRows, 1> residual;
  Eigen::Matrix<double, kRows, 6> slope = Eigen::Matrix<double, kRows, 6>::Zero();
  Eigen::Matrix<double, kRows, 6> slope_before = Eigen::Matrix<double, kRows, 6>::Zero();
  double deviation = 0.0;
};

/// Whether the camera looks below the horizon. `down`: to the ground, in the camera's frame.
bool looksDown(const Eigen::Vector3d& down);
/// Whether the beam of a range sensor, if there is one, meets the ground.
bool meetsGround(const HeightReading& reading, const Eigen::Vector3d& down);
bool meetsGround(const HeightReading& reading, const CameraPose& pose);
/// `rise`: vertical velocity, m/s. The residual is infinite if the beam does not meet the
/// ground.
PoseRows<1> rowsOf(const HeightReading& reading, const CameraPose& pose, double rise);
PoseRows<3> rowsOf(const DownReading& reading, const CameraPose& pose);

/// The pose with the given height and normal, and the base where it was: it turns as little as
/// possible. `lever`: of the base, in the camera's frame.
CameraPose onGround(const GroundFrame& frame, const CameraPose& pose, const Eigen::Vector3d& lever);
/// The first pose: above the origin, with the base's x axis along x. `frame` has a height.
CameraPose firstPose(const GroundFrame& frame, const Pose3& camera_to_base);

/// Constraint of the rotation since the pose `before`.
PoseRows<3> rowsOf(const TurnReading& reading, const CameraPose& pose, const CameraPose& before);

}  // namespace ktgp_orb::motion
