#pragma once

#include <ros/time.h>

#include <string>

#include "core/util/format.h"

namespace ktgp_orb {

/// "sec.nsec"
inline std::string textOf(const ros::Time& time) {
  return util::format("%u.%09u", time.sec, time.nsec);
}

}  // namespace ktgp_orb
