#pragma once

#include "ktgp_orb/ground_motion.h"
#include "motion/camera_pose.h"

namespace ktgp_orb::motion {

/// Pose and twist of the camera: the covariance of the pose as in CameraPose's steps (see moved),
/// the twist in the camera's frame.
struct CameraMotion {
  CameraPose pose;
  Matrix6 covariance;
  Vector6 twist;
  Matrix6 twist_covariance;
};

/// Writes the height, the pose of the base and, if its status has one, the twist of the base to
/// `estimate`. `origin`: the error of all lengths (scale_deviation) counts from there.
void reportBase(const CameraMotion& camera, const Eigen::Vector3d& origin,
                const GroundMotionOptions& options, GroundEstimate& estimate);

}  // namespace ktgp_orb::motion
