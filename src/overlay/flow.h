#pragma once

#include "ktgp_orb/overlay.h"

namespace ktgp_orb::overlay {

/// OverlayStyle::flow without the panel.
void drawFlow(const FrameView& reference, const FrameView& target, const MatchResult& result,
              cv::Mat& canvas);

}  // namespace ktgp_orb::overlay
