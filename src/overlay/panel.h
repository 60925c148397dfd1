#pragma once

#include <opencv2/core.hpp>

#include "ktgp_orb/ktgp_matcher.h"

namespace ktgp_orb::overlay {

/// Draws the panel at the left, from row `top` on or, where it has no room there, at the top:
/// status, milliseconds, uncertainty of the corners, and for each stage its colour with its
/// meaning, a bar, and the number of matches that ended there. `reference_size`: of the reference
/// image, px.
void drawPanel(const MatchResult& result, const cv::Size& reference_size, int top, cv::Mat& canvas);

}  // namespace ktgp_orb::overlay
