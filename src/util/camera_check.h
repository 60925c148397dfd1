#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

namespace ktgp_orb::util {

/// Throws std::invalid_argument unless `k`, 3x3, can be the matrix of a camera. It must be finite
/// and upper triangular with 1 as the last entry, and the focal lengths must be 0.15 to 50 times
/// the longer side of the image, which means a field of view of 147 to about 1 degree. `image`:
/// size of the image, px; if it is empty, nearly any focal length is accepted.
template <typename Matrix>
void requireK(std::string_view name, const Matrix& k, const cv::Size& image) {
  // A lens with a shorter focal length cannot show straight lines as straight.
  constexpr double kLeast = 0.15;
  constexpr double kMost = 50.0;  // more than the telephoto lens of any camera has
  constexpr double kAny = 1e12;   // px; upper limit if the image size is unknown
  for (int i = 0; i < 9; ++i) {
    if (std::isfinite(k(i / 3, i % 3))) continue;
    throw std::invalid_argument(std::string(name) + " has an entry that is not finite");
  }
  if (k(1, 0) != 0.0 || k(2, 0) != 0.0 || k(2, 1) != 0.0 || k(2, 2) != 1.0) {
    throw std::invalid_argument(std::string(name) +
                                " is not upper triangular with 1 as its last entry");
  }
  const int side = std::max(image.width, image.height);
  const double least = side > 0 ? kLeast * side : std::numeric_limits<double>::min();
  const double most = side > 0 ? kMost * side : kAny;
  for (const int i : {0, 1}) {
    const double focal_length = k(i, i);
    if (focal_length >= least && focal_length <= most) continue;
    std::ostringstream message;
    message << (i == 0 ? "fx of " : "fy of ") << name << " is " << focal_length
            << "; expected a focal length in [" << least << ", " << most << "] px";
    if (side > 0) message << " for an image of " << image.width << "x" << image.height << " px";
    throw std::invalid_argument(message.str());
  }
}

/// Throws std::invalid_argument unless the principal point of `k` is inside the image. `image`: see
/// requireK().
template <typename Matrix>
void requirePrincipalPoint(std::string_view name, const Matrix& k, const cv::Size& image) {
  if (image.empty() ||
      (k(0, 2) >= 0.0 && k(0, 2) < image.width && k(1, 2) >= 0.0 && k(1, 2) < image.height)) {
    return;
  }
  std::ostringstream message;
  message << name << " has its principal point at " << k(0, 2) << ", " << k(1, 2)
          << ", outside the image of " << image.width << "x" << image.height
          << " px; does it belong to another image size?";
  throw std::invalid_argument(message.str());
}

/// Throws std::invalid_argument unless `seconds` can be the readout time of a rolling shutter: the
/// time from the exposure of the first row to that of the last one. Below 0: the last row comes
/// first; 0: a global shutter; -1: not known.
inline void requireReadoutTime(double seconds) {
  constexpr double kLongest = 0.2;  // s
  if (seconds == -1.0 || std::abs(seconds) <= kLongest) return;
  throw std::invalid_argument(
      "readout_time is " + std::to_string(seconds) +
      "; expected -1, not known, 0, a global shutter, or up to 0.2 s, below "
      "0 where the last row is exposed first");
}

}  // namespace ktgp_orb::util
