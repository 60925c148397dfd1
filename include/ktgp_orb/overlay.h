#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>

#include "ktgp_orb/ktgp_matcher.h"

namespace ktgp_orb {

/// A frame as the overlay needs it: its image (8-bit grey or BGR) and the features found in it.
struct FrameView {
  const cv::Mat& image;
  const Features& features;
};

/// What drawOverlay shows.
enum class OverlayStyle : std::uint8_t {
  flow,          ///< the target alone; a stroke from where each final match was to where it is
  side_by_side,  ///< reference and target next to each other, some of the matches joined by lines
  difference,    ///< target minus warped reference: flat grey where the homography is right
};

/// "flow", "side_by_side", "difference"
const char* toString(OverlayStyle style);

/// Draws one pair of frames into `canvas` (8-bit BGR; the size of the target, side_by_side: of
/// both). Colours say how far a match came, in a palette that colour-blind people can tell apart
/// (Okabe & Ito, 2008): yellow = final, purple = removed by PROSAC, blue = by GMS, grey = by the
/// ratio filter. In `flow` the final ones are strokes, the others dots, and a white outline is the
/// reference image's border as the homography places it. Text and strokes grow with the image; a
/// panel gives the status, a bar per stage, the milliseconds and how uncertain the corners are.
/// Throws std::invalid_argument for an image that is neither CV_8UC1 nor CV_8UC3.
void drawOverlay(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 OverlayStyle style, cv::Mat& canvas);

/// Draws a frame that was not matched, with the reason for it. Throws as drawOverlay.
void drawUnmatched(const cv::Mat& target, const std::string& reason, cv::Mat& canvas);

/// Draws the four stages as in the paper's Figure 4 into one picture of 2 x 2 panels: KNN, KNN+TF,
/// KNN+TF+GMS, KNN+TF+GMS+PROSAC, each with its number of matches; see drawLevel.
void drawStages(const FrameView& reference, const FrameView& target, const MatchResult& result,
                cv::Mat& canvas);

/// Draws what is left after one stage, reference left and target right: lines join at most 150
/// matches, evenly chosen, and dots mark the others.
void drawLevel(const FrameView& reference, const FrameView& target, const MatchResult& result,
               Level level, cv::Mat& canvas);

}  // namespace ktgp_orb
