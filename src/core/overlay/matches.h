#pragma once

#include "ktgp_orb/overlay.h"

namespace ktgp_orb::overlay {

/// Reference and target side by side. Of the matches that reached at least `level`, at most 150
/// evenly chosen ones are joined by lines and the others are dots; `removed`: those that did not
/// are dots too. A thousand lines would hide both images.
void drawMatches(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 Level level, bool removed, cv::Mat& canvas);

}  // namespace ktgp_orb::overlay
