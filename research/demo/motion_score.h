#pragma once

#include <nav_msgs/Odometry.h>

#include <map>
#include <string>

namespace ktgp_orb::demo {

/// Odometry messages by their stamps.
using Odometries = std::map<ros::Time, nav_msgs::Odometry>;

/// Drift and velocity error of an odometry as a line of text, or a note if nothing can be compared.
std::string motionScore(const Odometries& truth, const Odometries& found);

}  // namespace ktgp_orb::demo
