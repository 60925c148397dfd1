#include "ktgp_orb/overlay.h"

#include <algorithm>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace ktgp_orb {
namespace {

const cv::Scalar kYellow(0, 255, 255);
const cv::Scalar kMagenta(255, 0, 255);
const cv::Scalar kOrange(0, 140, 255);
const cv::Scalar kRed(0, 0, 220);
const cv::Scalar kWhite(255, 255, 255);
constexpr double kLineOpacity = 0.3;
constexpr int kTextHeight = 18;  // px per line of text

void copyAsBgr(const cv::Mat& image, cv::Mat region) {
  if (image.type() == CV_8UC3) {
    image.copyTo(region);
  } else if (image.type() == CV_8UC1) {
    cv::cvtColor(image, region, cv::COLOR_GRAY2BGR);
  } else {
    throw std::invalid_argument("overlay image is " + cv::typeToString(image.type()) +
                                "; expected CV_8UC1 or CV_8UC3");
  }
}

void drawSideBySide(const cv::Mat& reference, const cv::Mat& target, cv::Mat& canvas) {
  canvas.create(std::max(reference.rows, target.rows), reference.cols + target.cols, CV_8UC3);
  canvas.setTo(cv::Scalar::all(0));
  if (!reference.empty()) copyAsBgr(reference, canvas(cv::Rect({0, 0}, reference.size())));
  if (!target.empty()) copyAsBgr(target, canvas(cv::Rect({reference.cols, 0}, target.size())));
}

/// Draws on a canvas that drawSideBySide has laid out.
class Painter {
 public:
  Painter(const FrameView& reference, const FrameView& target, cv::Mat& canvas)
      : reference_(reference), target_(target), canvas_(canvas) {}

  void line(const Correspondence& c, const cv::Scalar& colour) const {
    cv::line(canvas_, referencePoint(c), targetPoint(c), colour, 1, cv::LINE_AA);
  }

  void targetDot(const Correspondence& c, const cv::Scalar& colour) const {
    cv::circle(canvas_, targetPoint(c), 1, colour, cv::FILLED);
  }

  void referenceDot(const Correspondence& c, const cv::Scalar& colour) const {
    cv::circle(canvas_, referencePoint(c), 1, colour, cv::FILLED);
  }

 private:
  const cv::Point2f& referencePoint(const Correspondence& c) const {
    return reference_.features.keypoints[static_cast<std::size_t>(c.reference_index)].pt;
  }

  cv::Point2f targetPoint(const Correspondence& c) const {
    const auto& keypoints = target_.features.keypoints;
    const auto offset = static_cast<float>(reference_.image.cols);
    return keypoints[static_cast<std::size_t>(c.target_index)].pt + cv::Point2f(offset, 0.F);
  }

  const FrameView& reference_;
  const FrameView& target_;
  cv::Mat& canvas_;
};

/// White text on a darkened strip, so that it can be read on any image.
void drawText(cv::Mat& canvas, int line, const std::string& text) {
  const cv::Rect strip(0, line * kTextHeight, canvas.cols, kTextHeight);
  const cv::Rect visible = strip & cv::Rect({0, 0}, canvas.size());
  if (visible.empty()) return;
  cv::Mat region = canvas(visible);
  region.convertTo(region, -1, 0.35);
  cv::putText(canvas, text, {6, (line + 1) * kTextHeight - 5}, cv::FONT_HERSHEY_SIMPLEX, 0.45,
              kWhite, 1, cv::LINE_AA);
}

std::string describe(const MatchResult& result, bool milliseconds) {
  std::string text = milliseconds ? "ms  " : "matches  ";
  char buffer[64];
  for (const StageResult& stage : result.stages) {
    if (milliseconds) {
      std::snprintf(buffer, sizeof(buffer), " %s %.2f", stage.name, stage.milliseconds);
    } else {
      std::snprintf(buffer, sizeof(buffer), " %s %zu", stage.name, stage.output);
    }
    text += buffer;
  }
  if (!milliseconds) text += std::string("   ") + toString(result.status);
  return text;
}

}  // namespace

void drawOverlay(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 cv::Mat& canvas) {
  drawSideBySide(reference.image, target.image, canvas);
  cv::Mat lines = canvas.clone();
  const auto for_each = [&](Level level, const auto& draw) {
    for (const Correspondence& c : result.correspondences) {
      if (c.level == level) draw(c);
    }
  };
  const Painter line_painter(reference, target, lines);
  for_each(Level::kt, [&](const auto& c) { line_painter.line(c, kOrange); });
  for_each(Level::ktg, [&](const auto& c) { line_painter.line(c, kMagenta); });
  for_each(Level::ktgp, [&](const auto& c) { line_painter.line(c, kYellow); });
  // A thousand solid lines would hide the images.
  cv::addWeighted(lines, kLineOpacity, canvas, 1.0 - kLineOpacity, 0.0, canvas);

  const Painter painter(reference, target, canvas);
  const auto dots = [&](const auto& c, const cv::Scalar& colour) {
    painter.referenceDot(c, colour);
    painter.targetDot(c, colour);
  };
  // Where a match is ambiguous the line says nothing.
  for_each(Level::knn, [&](const auto& c) { painter.targetDot(c, kRed); });
  for_each(Level::kt, [&](const auto& c) { dots(c, kOrange); });
  for_each(Level::ktg, [&](const auto& c) { dots(c, kMagenta); });
  for_each(Level::ktgp, [&](const auto& c) { dots(c, kYellow); });
  drawText(canvas, 0, describe(result, false));
  drawText(canvas, 1, describe(result, true));
}

void drawLevel(const FrameView& reference, const FrameView& target, const MatchResult& result,
               Level level, cv::Mat& canvas) {
  drawSideBySide(reference.image, target.image, canvas);
  const Painter painter(reference, target, canvas);
  for (const Correspondence& c : result.correspondences) {
    if (c.level >= level) painter.line(c, kYellow);
  }
}

void drawStages(const FrameView& reference, const FrameView& target, const MatchResult& result,
                cv::Mat& canvas) {
  const char* const names[] = {"(a) KNN", "(b) KNN+TF", "(c) KNN+TF+GMS", "(d) KNN+TF+GMS+PROSAC"};
  constexpr int kGap = 8;  // px between panels
  cv::Mat panel;
  for (int i = 0; i < 4; ++i) {
    const auto level = static_cast<Level>(i);
    drawLevel(reference, target, result, level, panel);
    drawText(panel, 0,
             std::string(names[i]) + ": " +
                 std::to_string(countAtLeast(result.correspondences, level)) + " matches");
    if (i == 0) {
      canvas.create(2 * panel.rows + kGap, 2 * panel.cols + kGap, CV_8UC3);
      canvas.setTo(cv::Scalar::all(255));
    }
    const cv::Point corner((i % 2) * (panel.cols + kGap), (i / 2) * (panel.rows + kGap));
    panel.copyTo(canvas(cv::Rect(corner, panel.size())));
  }
}

}  // namespace ktgp_orb
