#pragma once

#include <algorithm>
#include <string>

namespace ktgp_orb::util {

/// The name of a frame for tf2, whose names have no leading slash.
inline std::string withoutSlash(const std::string& frame) {
  return frame.substr(std::min(frame.find_first_not_of('/'), frame.size()));
}

}  // namespace ktgp_orb::util
