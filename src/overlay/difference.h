#pragma once

#include "ktgp_orb/overlay.h"

namespace ktgp_orb::overlay {

/// OverlayStyle::difference without the panel: 128 + (target - warped reference) / 2 in grey
/// values, after the images got the same mean and contrast. Darkened target outside the warped
/// reference, or everywhere if there is no homography.
void drawDifference(const FrameView& reference, const FrameView& target, const MatchResult& result,
                    cv::Mat& canvas);

}  // namespace ktgp_orb::overlay
