#pragma once

#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <sstream>
#include <stdexcept>
#include <string>

namespace ktgp_orb::util {

/// Throws std::invalid_argument "<name> is <value>; expected a value in [low, high]" unless
/// low <= value <= high (NaN is refused).
template <typename T>
void requireInRange(const std::string& name, T value, T low, T high) {
  if (value >= low && value <= high) return;
  std::ostringstream message;
  message << name << " is " << value << "; expected a value in [" << low << ", " << high << "]";
  throw std::invalid_argument(message.str());
}

/// Throws std::invalid_argument unless `k`, 3x3, can be the matrix of a camera: finite, with
/// 0, 0, 1 as its last row, and focal lengths, in sides of the image, from a field of view of
/// nearly 180 degrees to one of arc seconds. `image`: its size; empty: not known.
template <typename Matrix>
void requireCamera(const std::string& name, const Matrix& k, const cv::Size& image) {
  constexpr double kLeast = 1e-3;
  constexpr double kMost = 1e5;
  constexpr double kAny = 1e12;  // px
  for (int i = 0; i < 9; ++i) {
    if (std::isfinite(k(i / 3, i % 3))) continue;
    throw std::invalid_argument(name + " has an entry that is not finite");
  }
  if (k(1, 0) != 0.0 || k(2, 0) != 0.0 || k(2, 1) != 0.0 || k(2, 2) != 1.0) {
    throw std::invalid_argument(name + " is not upper triangular with 1 as its last entry");
  }
  const auto require = [&](const std::string& axis, double focal_length, int side) {
    requireInRange("f" + axis + " of " + name, focal_length,
                   side > 0 ? kLeast * side : std::numeric_limits<double>::min(),
                   side > 0 ? kMost * side : kAny);
  };
  require("x", k(0, 0), image.width);
  require("y", k(1, 1), image.height);
}

}  // namespace ktgp_orb::util
