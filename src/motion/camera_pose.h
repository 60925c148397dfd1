#pragma once

#include <Eigen/Core>
#include <optional>

#include "util/geometry.h"

namespace ktgp_orb::motion {

using util::crossed;
using util::rotationAbout;

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Matrix612 = Eigen::Matrix<double, 6, 12>;

/// Pose of the camera above the ground z = 0 (z up).
struct CameraPose {
  /// Rotation from the camera to the ground frame.
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  /// Position of the camera in the ground frame, m.
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
};

/// The rotation vector (axis times angle, rad) of a rotation matrix; the inverse of
/// rotationAbout().
Eigen::Vector3d turnOf(const Eigen::Matrix3d& rotation);
/// aboutUp(): the rotation by `yaw`, rad, about the z axis. yawOf(): the yaw of a rotation, rad.
Eigen::Matrix3d aboutUp(double yaw);
double yawOf(const Eigen::Matrix3d& rotation);
/// The smallest rotation that turns `from` into `to`; both have length 1.
Eigen::Matrix3d rotationBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to);

/// The pose after a step. The first three entries of the step move the position in the ground frame
/// (m), and the last three are small rotations about the camera's own axes (rad).
CameraPose moved(const CameraPose& pose, const Vector6& step);

/// The homography M of GroundMotion: maps a point (x, y, 1) of the ground, m, to an image with
/// focal length 1.
Eigen::Matrix3d imageFromGround(const CameraPose& pose);
/// The pose for which imageFromGround() is nearest to `image_from_ground`, which is known only up
/// to a factor. Empty if there is no such pose above the ground.
std::optional<CameraPose> poseFrom(const Eigen::Matrix3d& image_from_ground);

/// The motion from `from` to `to` at constant velocity and constant angular velocity. Returns both,
/// in the moving camera's frame and multiplied by the duration: m and rad. This is the logarithm of
/// the motion in SE(3).
Vector6 constantTwist(const CameraPose& from, const CameraPose& to);
/// Jacobian of constantTwist() with respect to a step (see moved()) of `from` (6 columns) and a
/// step of `to` (6 columns).
Matrix612 twistSlope(const CameraPose& from, const CameraPose& to);

}  // namespace ktgp_orb::motion
