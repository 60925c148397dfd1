#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Conversion of 16-bit grey values to 8 bits. Cameras deliver values of 10, 12 or 14 bits in 16
/// bits; thermal cameras use only a few hundred values.
enum class GreyStretch {
  /// Stretches the values between the darkest and the brightest pixel of the frame. At each end,
  /// 0.1 % of the pixels are ignored, because they may be hot pixels.
  percentile,
  /// Stretches the values from 0 to 65535 in all frames, so that their brightness can be compared.
  range,
};

/// Converts an image of type CV_16UC1. The result is CV_8UC1 of the same size; values beyond the
/// ends become 0 or 255. If all pixels between the ends are equal, the result is 0.
cv::Mat stretchTo8Bit(const cv::Mat& image, GreyStretch stretch = GreyStretch::percentile);

}  // namespace ktgp_orb::util
