#pragma once

#include <ros/time.h>

#include <Eigen/Core>
#include <cstdint>
#include <cstdio>
#include <string>

namespace ktgp_orb {

inline std::int64_t nanosecondsOf(const ros::Time& time) {
  return static_cast<std::int64_t>(time.toNSec());
}

/// "sec.nsec"
inline std::string textOf(std::int64_t nanoseconds) {
  ros::Time time;
  time.fromNSec(static_cast<std::uint64_t>(nanoseconds));
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%u.%09u", time.sec, time.nsec);
  return buffer;
}

/// ",h00,h01,...,h22" and the end of the line.
inline std::string textOf(const Eigen::Matrix3d& h) {
  std::string row;
  char buffer[32];
  for (int i = 0; i < 9; ++i) {
    std::snprintf(buffer, sizeof buffer, ",%.17g", h(i / 3, i % 3));
    row += buffer;
  }
  return row + '\n';
}

}  // namespace ktgp_orb
