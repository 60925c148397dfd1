#include "ktgp_orb/overlay.h"

#include "core/util/names.h"
#include "overlay/canvas.h"
#include "overlay/styles.h"
#include "overlay/text.h"

namespace ktgp_orb {
namespace {

using overlay::copyAsBgr;
using overlay::darken;
using overlay::drawDifference;
using overlay::drawEpipolarLines;
using overlay::drawFlow;
using overlay::drawMatches;
using overlay::drawOutline;
using overlay::drawPanel;
using overlay::Typeface;

/// A line of text along the upper border, on a darkened strip.
void drawTitle(const std::string& text, cv::Mat& canvas) {
  const Typeface face(canvas.size());
  const int margin = face.lineHeight() / 3;
  darken(canvas, {0, 0, canvas.cols, face.lineHeight() + 2 * margin});
  face.draw(canvas, text, {margin, margin});
}

}  // namespace

const char* toString(OverlayStyle style) {
  return util::nameOf<OverlayStyle::difference>(style, {"flow", "side_by_side", "difference"});
}

void drawOverlay(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 OverlayStyle style, cv::Mat& canvas) {
  switch (style) {
    case OverlayStyle::flow:
      drawFlow(reference, target, result, canvas);
      break;
    case OverlayStyle::side_by_side: {
      drawMatches(reference, target, result, Level::ktgp, true, canvas);
      cv::Mat right = canvas(cv::Rect({reference.image.cols, 0}, target.image.size()));
      const int stroke = Typeface(canvas.size()).stroke();
      drawOutline(reference.image.size(), result, stroke, right);
      drawEpipolarLines(reference, target, result, stroke, right);
      break;
    }
    case OverlayStyle::difference:
      drawDifference(reference, target, result, canvas);
      break;
  }
  // A smaller reference leaves room below it.
  const int top = style == OverlayStyle::side_by_side ? reference.image.rows : 0;
  drawPanel(result, reference.image.size(), top, canvas);
}

void drawUnmatched(const cv::Mat& target, const std::string& reason, cv::Mat& canvas) {
  canvas.create(target.size(), CV_8UC3);
  if (canvas.empty()) return;
  copyAsBgr(target, canvas);
  canvas.convertTo(canvas, -1, 0.7, 15.0);
  drawTitle(reason, canvas);
}

void drawLevel(const FrameView& reference, const FrameView& target, const MatchResult& result,
               Level level, cv::Mat& canvas) {
  drawMatches(reference, target, result, level, false, canvas);
}

void drawStages(const FrameView& reference, const FrameView& target, const MatchResult& result,
                cv::Mat& canvas) {
  const char* const names[] = {"(a) KNN", "(b) KNN+TF", "(c) KNN+TF+GMS", "(d) KNN+TF+GMS+PROSAC"};
  constexpr int kGap = 8;  // px between panels
  cv::Mat panel;
  for (int i = 0; i < 4; ++i) {
    const auto level = static_cast<Level>(i);
    drawLevel(reference, target, result, level, panel);
    drawTitle(std::string(names[i]) + ": " +
                  std::to_string(countAtLeast(result.correspondences, level)) + " matches",
              panel);
    if (i == 0) {
      canvas.create(2 * panel.rows + kGap, 2 * panel.cols + kGap, CV_8UC3);
      canvas.setTo(cv::Scalar::all(255));
    }
    const cv::Point corner((i % 2) * (panel.cols + kGap), (i / 2) * (panel.rows + kGap));
    panel.copyTo(canvas(cv::Rect(corner, panel.size())));
  }
}

}  // namespace ktgp_orb
