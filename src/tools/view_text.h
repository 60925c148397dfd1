#pragma once

#include <ros/time.h>

#include <cstdint>
#include <string>

#include "core/util/format.h"

namespace ktgp_orb {

inline std::int64_t nanosecondsOf(const ros::Time& time) {
  return static_cast<std::int64_t>(time.toNSec());
}

/// "sec.nsec"
inline std::string textOf(const ros::Time& time) {
  return util::format("%u.%09u", time.sec, time.nsec);
}

inline std::string textOf(std::int64_t nanoseconds) {
  ros::Time time;
  return textOf(time.fromNSec(static_cast<std::uint64_t>(nanoseconds)));
}

}  // namespace ktgp_orb
