#pragma once

#include "ktgp_orb/overlay.h"

namespace ktgp_orb::overlay {

/// OverlayStyle::flow without the panel.
void drawFlow(const FrameView& reference, const FrameView& target, const MatchResult& result,
              cv::Mat& canvas);

/// The border of the reference image mapped by the homography, if there is one, into the target's
/// part of the canvas.
void drawOutline(const cv::Size& reference_size, const MatchResult& result, int stroke,
                 cv::Mat& canvas);

/// The epipolar lines of a few final matches, if that is the geometry, into the target's part of
/// the canvas. A line that misses its match, since the lens bends it, is left out.
void drawEpipolarLines(const FrameView& reference, const FrameView& target,
                       const MatchResult& result, int stroke, cv::Mat& canvas);

}  // namespace ktgp_orb::overlay
