#pragma once

#include <nav_msgs/Odometry.h>

#include <map>
#include <string>

namespace ktgp_orb::demo {

/// Compares an odometry with the true one.
class MotionScore {
 public:
  void addTruth(const nav_msgs::Odometry& truth) { truth_[truth.header.stamp] = truth; }
  void addMessage(const nav_msgs::OdometryConstPtr& odometry) {
    found_[odometry->header.stamp] = *odometry;
  }
  /// Drift and velocity error in a line; says so where there is nothing to compare.
  std::string text() const;

 private:
  std::map<ros::Time, nav_msgs::Odometry> truth_;
  std::map<ros::Time, nav_msgs::Odometry> found_;
};

}  // namespace ktgp_orb::demo
