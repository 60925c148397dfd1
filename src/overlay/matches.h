#pragma once

#include "ktgp_orb/overlay.h"

namespace ktgp_orb::overlay {

/// Reference and target side by side. Lines join at most 150 of the matches that reached at least
/// `level`, evenly chosen; the others are dots. `removed`: matches below `level` are dots, too. A
/// thousand lines would hide both images.
void drawMatches(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 Level level, bool removed, cv::Mat& canvas);

}  // namespace ktgp_orb::overlay
