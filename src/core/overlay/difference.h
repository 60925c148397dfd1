#pragma once

#include "ktgp_orb/overlay.h"

namespace ktgp_orb::overlay {

/// OverlayStyle::difference without the panel: 128 + (target - warped reference) / 2 in grey
/// values, the images brought to the same mean and contrast first. Darkened target where the
/// reference does not reach, and everywhere where there is no homography.
void drawDifference(const FrameView& reference, const FrameView& target, const MatchResult& result,
                    cv::Mat& canvas);

}  // namespace ktgp_orb::overlay
