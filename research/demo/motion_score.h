#pragma once

#include <nav_msgs/Odometry.h>

#include <map>
#include <string>

namespace ktgp_orb::demo {

/// By their stamps.
using Odometries = std::map<ros::Time, nav_msgs::Odometry>;

/// Drift and velocity error of an odometry in a line; says so where there is nothing to compare.
std::string motionScore(const Odometries& truth, const Odometries& found);

}  // namespace ktgp_orb::demo
