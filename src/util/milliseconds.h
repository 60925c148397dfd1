#pragma once

#include <chrono>

namespace ktgp_orb::util {

/// Time that has passed since `start`, ms.
inline double millisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

}  // namespace ktgp_orb::util
