#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// How 16-bit grey values become 8-bit ones. Cameras deliver 10, 12 or 14 bits in 16, and thermal
/// ones a few hundred values somewhere in the middle.
struct GreyStretch {
  enum class Kind {
    percentile,  ///< from the frame's own dark end to its bright end, without the outermost pixels
    range,       ///< from `low` to `high`: the same for all frames, for matching brightness
  };
  Kind kind = Kind::percentile;
  double percentile = 0.1;  ///< pixels ignored at either end, in percent, [0, 49]: hot pixels
  int low = 0;              ///< range: what becomes 0, in [0, high)
  int high = 65535;         ///< range: what becomes 255, up to 65535
};

/// Throws std::invalid_argument naming the field and its range.
void requireValid(const GreyStretch& stretch);

/// `image`: CV_16UC1. CV_8UC1 of the same size; values beyond the ends become 0 or 255. Where all
/// pixels between the ends are equal the result is 0.
cv::Mat stretchTo8Bit(const cv::Mat& image, const GreyStretch& stretch = {});

}  // namespace ktgp_orb::util
