#pragma once

#include "ktgp_orb/overlay.h"

/// What an overlay is made of.
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

/// Reference and target side by side. Lines join at most 150 of the matches that reached at least
/// `level`, evenly chosen; the others are dots. `removed`: matches below `level` are dots, too. A
/// thousand lines would hide both images.
void drawMatches(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 Level level, bool removed, cv::Mat& canvas);

/// OverlayStyle::difference without the panel: 128 + (target - warped reference) / 2 in grey
/// values, after the images got the same mean and contrast. Darkened target outside the warped
/// reference, or everywhere if there is no homography.
void drawDifference(const FrameView& reference, const FrameView& target, const MatchResult& result,
                    cv::Mat& canvas);

/// Draws the panel at the left, from row `top` on or, where it has no room there, at the top:
/// status, milliseconds, uncertainty of the corners, and for each stage its colour with its
/// meaning, a bar, and the number of matches that ended there. `reference_size`: of the reference
/// image, px.
void drawPanel(const MatchResult& result, const cv::Size& reference_size, int top, cv::Mat& canvas);

}  // namespace ktgp_orb::overlay
