#pragma once

#include <ros/duration.h>
#include <ros/time.h>

namespace ktgp_orb {

/// Seconds from `start` to `end`, accurate to a microsecond. We do not subtract two ros::Time,
/// because this throws beyond 68 years, and stamps in messages may have any value.
inline double secondsBetween(const ros::Time& start, const ros::Time& end) {
  return end.toSec() - start.toSec();
}

/// `time` plus `seconds`, but at most ros::TIME_MAX, because ros::Time throws on overflow.
inline ros::Time later(const ros::Time& time, double seconds) {
  if (time.toSec() + seconds >= ros::TIME_MAX.toSec()) return ros::TIME_MAX;
  return time + ros::Duration(seconds);
}

}  // namespace ktgp_orb
