#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::orb {

/// Throws std::invalid_argument unless the image is 8-bit grey and the mask is empty or fits it.
void requireValid(const cv::Mat& image, const cv::Mat& mask);

}  // namespace ktgp_orb::orb
