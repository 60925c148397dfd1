#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Conversion of 16-bit grey values to 8 bits. Cameras deliver 10, 12 or 14 bits in 16; thermal
/// ones use only a few hundred values.
struct GreyStretch {
  enum class Kind {
    percentile,  ///< from the frame's own dark end to its bright end, without outliers
    range,  ///< from `low` to `high`: the same for all frames, so that brightness is comparable
  };
  Kind kind = Kind::percentile;
  double percentile = 0.1;  ///< pixels ignored at each end, in percent, [0, 49]: hot pixels
  int low = 0;              ///< range: value that becomes 0, in [0, high)
  int high = 65535;         ///< range: value that becomes 255, up to 65535
};

/// Throws std::invalid_argument naming the field and its range.
void requireValid(const GreyStretch& stretch);

/// `image`: CV_16UC1. The result is CV_8UC1 of the same size; values beyond the ends become 0 or
/// 255. If all pixels between the ends are equal, the result is 0.
cv::Mat stretchTo8Bit(const cv::Mat& image, const GreyStretch& stretch = {});

}  // namespace ktgp_orb::util
