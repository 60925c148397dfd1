#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Conversion of 16-bit grey values to 8 bits. Cameras deliver 10, 12 or 14 bits in 16; thermal
/// cameras use only a few hundred values.
enum class GreyStretch {
  /// From the dark end to the bright end of the frame's values, without 0.1 % of the pixels at each
  /// end, which may be hot pixels.
  percentile,
  range,  ///< from 0 to 65535: the same for all frames, so that brightness is comparable
};

/// `image`: CV_16UC1. The result is CV_8UC1 of the same size; values beyond the ends become 0 or
/// 255. If all pixels between the ends are equal, the result is 0.
cv::Mat stretchTo8Bit(const cv::Mat& image, GreyStretch stretch = GreyStretch::percentile);

}  // namespace ktgp_orb::util
