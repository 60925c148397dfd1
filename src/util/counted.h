#pragma once

#include <cstddef>
#include <string>

namespace ktgp_orb::util {

/// A number with its noun: "1 map", "2 maps". `one`: the singular. `more`: the plural; may be left
/// out if it is `one` with an s.
inline std::string counted(std::size_t count, const std::string& one,
                           const std::string& more = {}) {
  return std::to_string(count) + " " + (count == 1 ? one : more.empty() ? one + "s" : more);
}

}  // namespace ktgp_orb::util
