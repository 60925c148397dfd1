#pragma once

#include <opencv2/core.hpp>

#include "ktgp_orb/ktgp_matcher.h"

namespace ktgp_orb {

/// A frame as the overlay needs it: its image (8-bit grey or BGR) and the features found in it.
struct FrameView {
  const cv::Mat& image;
  const Features& features;
};

/// Draws reference (left) and target (right) side by side into `canvas` (8-bit BGR): yellow lines
/// join the final matches; magenta lines are what PROSAC removed, orange lines what GMS removed,
/// red dots the target keypoints that the ratio filter removed. Two lines of text give counts and
/// milliseconds. Throws std::invalid_argument for an image that is neither CV_8UC1 nor CV_8UC3.
void drawOverlay(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 cv::Mat& canvas);

/// Draws the four stages as in the paper's Figure 4 into one picture of 2 x 2 panels: KNN, KNN+TF,
/// KNN+TF+GMS, KNN+TF+GMS+PROSAC, each with its matches as yellow lines.
void drawStages(const FrameView& reference, const FrameView& target, const MatchResult& result,
                cv::Mat& canvas);

/// Draws what is left after one stage as yellow lines, reference left and target right.
void drawLevel(const FrameView& reference, const FrameView& target, const MatchResult& result,
               Level level, cv::Mat& canvas);

}  // namespace ktgp_orb
