#pragma once

#include <ros/duration.h>
#include <ros/time.h>

namespace ktgp_orb {

/// Seconds from `start` to `end`, to a microsecond. The difference of two ros::Time throws beyond
/// 68 years, and messages may have any stamps.
inline double secondsBetween(const ros::Time& start, const ros::Time& end) {
  return end.toSec() - start.toSec();
}

/// `time` plus `seconds`, limited to the range of ros::Time, which would throw.
inline ros::Time later(const ros::Time& time, double seconds) {
  if (time.toSec() + seconds >= ros::TIME_MAX.toSec()) return ros::TIME_MAX;
  return time + ros::Duration(seconds);
}

}  // namespace ktgp_orb
