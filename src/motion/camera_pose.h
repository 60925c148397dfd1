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
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  ///< camera -> ground frame
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< in the ground frame, m
};

/// The rotation vector (axis times angle, rad) of a matrix: the inverse of rotationAbout.
Eigen::Vector3d turnOf(const Eigen::Matrix3d& rotation);
/// The rotation about z by `yaw`, and the yaw of a rotation.
Eigen::Matrix3d aboutUp(double yaw);
double yawOf(const Eigen::Matrix3d& rotation);
/// The smallest rotation that turns `from` to `to`; both have length 1.
Eigen::Matrix3d rotationBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to);

/// The pose after a step: three entries move the position in the ground frame (m), and three are
/// small rotations about the camera's own axes (rad).
CameraPose moved(const CameraPose& pose, const Vector6& step);

/// The homography M: point (x, y, 1) of the ground -> image at focal length 1.
Eigen::Matrix3d imageFromGround(const CameraPose& pose);
/// The pose whose M is nearest to `image_from_ground`, which is known up to a factor. Empty if
/// there is no such pose above the ground.
std::optional<CameraPose> poseFrom(const Eigen::Matrix3d& image_from_ground);

/// The constant velocity and angular velocity that move the camera from `from` to `to`, in the
/// moving frame and multiplied by the duration: the logarithm of SE(3).
Vector6 constantTwist(const CameraPose& from, const CameraPose& to);
/// Derivatives of constantTwist by a step (see moved) of `from` (6 columns) and of `to` (6).
Matrix612 twistSlope(const CameraPose& from, const CameraPose& to);

}  // namespace ktgp_orb::motion
