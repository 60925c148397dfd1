#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"

namespace ktgp_orb {

/// A frame for the overlay: its image (8-bit grey or BGR) and its features.
struct FrameView {
  const cv::Mat& image;
  const Features& features;
};

/// Kinds of pictures that drawOverlay can draw.
enum class OverlayStyle : std::uint8_t {
  flow,          ///< the target, with a stroke from the old to the new position of each final match
  side_by_side,  ///< reference and target side by side, with lines that join some of the matches
  difference,    ///< target minus warped reference; it is uniformly grey if the homography is right
};

/// Returns "flow", "side_by_side" or "difference".
const char* toString(OverlayStyle style);

/// Draws one pair of frames into `canvas` (8-bit BGR), which gets the size of the target or, for
/// side_by_side, of both images side by side. The colour of a match shows which stage removed it,
/// in a palette for colour-blind people (Okabe & Ito, 2008): yellow = final, purple = removed by
/// PROSAC, blue = removed by GMS, grey = removed by the ratio filter. In `flow`, final matches are
/// strokes and all other matches are dots. In `flow` and side_by_side, a white outline shows where
/// the homography maps the border of the reference image. Final matches of an epipolar geometry are
/// green, and some white epipolar lines are drawn in the target. Text and strokes are larger in
/// larger images. A panel shows the status, a bar for each stage, the time in ms, and the
/// uncertainty of the corners. Throws std::invalid_argument for an image that is neither CV_8UC1
/// nor CV_8UC3.
void drawOverlay(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 OverlayStyle style, cv::Mat& canvas);

/// Draws a frame that was not matched, and the reason as text. Throws in the same cases as
/// drawOverlay.
void drawUnmatched(const cv::Mat& target, const std::string& reason, cv::Mat& canvas);

/// Draws the four stages into one picture of 2 x 2 panels, as in the paper's Figure 4: KNN, KNN+TF,
/// KNN+TF+GMS, KNN+TF+GMS+PROSAC. Each panel states the number of matches; see drawLevel.
void drawStages(const FrameView& reference, const FrameView& target, const MatchResult& result,
                cv::Mat& canvas);

/// Draws the matches that remain after one stage, with the reference on the left and the target on
/// the right. At most 150 matches, chosen evenly from the list, are drawn as lines; all other
/// matches are dots.
void drawLevel(const FrameView& reference, const FrameView& target, const MatchResult& result,
               Level level, cv::Mat& canvas);

}  // namespace ktgp_orb
