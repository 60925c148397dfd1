#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Where a picture of four channels, the last of which is opacity, is at least half opaque: 255,
/// elsewhere 0 (CV_8UC1). Empty if opacity says nothing: it is on one side everywhere, as of
/// drivers that leave it zero, or there are fewer channels.
cv::Mat visiblePart(const cv::Mat& picture);

/// Continues the picture smoothly from where `visible` is not 0 to where it is, so that no feature
/// is there. 8 or 16 bits, any channels; nothing is done for an empty `visible`.
void fillHidden(const cv::Mat& visible, cv::Mat& picture);

}  // namespace ktgp_orb::util
