#pragma once

namespace ktgp_orb::util {

/// a / b, rounded up. Requires a >= 0 and b > 0.
template <typename T>
constexpr T ceilDivide(T a, T b) {
  return (a + b - 1) / b;
}

}  // namespace ktgp_orb::util
