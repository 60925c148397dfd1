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

/// A homography between images of focal length 1. The covariance is for its first eight entries,
/// row by row; the last entry is 1.
struct ImageMotion {
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();
  Matrix8 covariance = Matrix8::Zero();
  /// Change of the entries per second of readout time, see Shutter.
  Vector8 by_readout = Vector8::Zero();
};

/// Shares of the covariance of a homography, measured on rendered flights. kOfKeyframe is due to
/// the image of the keyframe, whose noise is the same for all later frames. kOfFrame is due to the
/// other image.
inline constexpr double kOfKeyframe = 0.6;
inline constexpr double kOfFrame = 0.4;

/// Converts a homography from pixels to focal length 1; `camera`: K. The deviation of each entry
/// grows by 1e-6, so that no deviation is 0 for pictures without noise.
ImageMotion inImageUnits(const Eigen::Matrix3d& homography, const Covariance8& covariance,
                         const Eigen::Matrix3d& camera);

/// Derivatives of the entries of h = M(pose) map: byPose by a step of the pose (see moved), byMap
/// by the entries of E in map (I + E) with E(2,2) = 0.
Matrix86 byPose(const Eigen::Matrix3d& h, const Eigen::Matrix3d& map, const CameraPose& pose);
Matrix8 byMap(const Eigen::Matrix3d& h);

/// Column i is the E for which entry i of h (I + E) is larger by 1 than entry i of h.
Matrix8 mapFromEntries(const Eigen::Matrix3d& h);

/// A linearised measurement of the newest and the previous pose: residual ~ slope * step +
/// slope_before * step of the previous pose + noise of the given deviation.
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
/// Linearises a reading about `pose`. `rise`: vertical velocity, m/s. The residual is infinite if
/// the beam does not meet the ground.
PoseRows<1> rowsOf(const HeightReading& reading, const CameraPose& pose, double rise);
PoseRows<3> rowsOf(const DownReading& reading, const CameraPose& pose);

/// The pose with the height and normal of `frame`. The camera turns as little as possible, and the
/// base keeps x and y. `lever`: position of the base in the camera's frame.
CameraPose onGround(const GroundFrame& frame, const CameraPose& pose, const Eigen::Vector3d& lever);
/// The first pose: the base above the origin, with its x axis along x. `frame` must have a height.
CameraPose firstPose(const GroundFrame& frame, const Pose3& camera_to_base);

/// Linearises a reading of the rotation since the pose `before`.
PoseRows<3> rowsOf(const TurnReading& reading, const CameraPose& pose, const CameraPose& before);

}  // namespace ktgp_orb::motion
