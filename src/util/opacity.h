#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Mask (CV_8UC1) of the visible part of a picture whose fourth channel is opacity: 255 where the
/// picture is at least half opaque, else 0. The mask is empty if there is no fourth channel, or if
/// all pixels would have the same value, because some drivers set the opacity of all pixels to
/// zero.
cv::Mat visiblePart(const cv::Mat& picture);

/// Fills the pixels where `visible` is 0 smoothly from the pixels around them, so that no features
/// are found there. Accepts pictures of 8 or 16 bits with any number of channels. Does nothing if
/// `visible` is empty.
void fillHidden(const cv::Mat& visible, cv::Mat& picture);

}  // namespace ktgp_orb::util
