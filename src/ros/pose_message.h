#pragma once

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/PoseWithCovariance.h>
#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/TwistWithCovariance.h>
#include <std_msgs/Header.h>

#include <string>

#include "ktgp_orb/ground_motion.h"

namespace ktgp_orb {

/// Convert poses and velocities to messages and back.
geometry_msgs::PoseWithCovariance toMessage(const Pose3& pose, const Covariance6& covariance);
geometry_msgs::TwistWithCovariance toMessage(const Twist6& twist, const Covariance6& covariance);

/// Converts a pose to a transform for tf. `pose`: pose of the frame `child` in the frame that the
/// header names.
geometry_msgs::TransformStamped transformOf(const std_msgs::Header& header,
                                            const std::string& child,
                                            const geometry_msgs::Pose& pose);

/// Convert a message to our types. They throw std::invalid_argument for numbers that are not
/// finite, an orientation that is not a unit quaternion, or a covariance that is not symmetric and
/// positive semidefinite.
Pose3 poseOf(const geometry_msgs::Pose& pose);
Covariance6 covarianceOf(const geometry_msgs::PoseWithCovariance& pose);

}  // namespace ktgp_orb
