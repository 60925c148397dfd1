#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// How 16-bit grey values are converted to 8 bits. Cameras store values of 10, 12 or 14 bits in 16
/// bits; thermal cameras use only a few hundred values.
enum class GreyStretch {
  /// Maps the values between the darkest and the brightest pixel of each frame to 0..255. Ignores
  /// the darkest and the brightest 0.1 % of the pixels, because they may be hot pixels.
  percentile,
  /// Maps the range 0..65535 to 0..255 in every frame, so that the brightness of different frames
  /// can be compared.
  range,
};

/// Converts an image from CV_16UC1 to CV_8UC1. Values outside the stretched range become 0 or 255.
/// If the darkest and the brightest value are equal, all pixels become 0.
cv::Mat stretchTo8Bit(const cv::Mat& image, GreyStretch stretch = GreyStretch::percentile);

}  // namespace ktgp_orb::util
