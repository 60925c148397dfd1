#include "ktgp_orb/overlay.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "homography/part_in_view.h"
#include "overlay/canvas.h"
#include "util/format.h"
#include "util/keypoint_position.h"
#include "util/names.h"

namespace ktgp_orb {
namespace overlay {
namespace {

using util::format;
using util::imagePoint;

/// Returns true if `i` is one of `chosen` evenly spaced indices below `count`.
bool isChosen(std::size_t i, std::size_t count, std::size_t chosen) {
  return (i + 1) * chosen / count != i * chosen / count;
}

// We give drawing positions to OpenCV in 1/16 px: with whole pixels, the drawing would jump in slow
// motions.
constexpr int kFractionBits = 4;

cv::Point subpixel(double x, double y) {
  constexpr double kUnit = 1 << kFractionBits;
  return {cvRound(x * kUnit), cvRound(y * kUnit)};
}

cv::Point subpixel(const cv::Point2f& p) {
  return subpixel(p.x, p.y);
}

/// Draws the image as a dimmed background: each value times `share`, plus `offset`. Returns false
/// if the image is empty.
bool drawDimmed(const cv::Mat& image, double share, double offset, cv::Mat& canvas) {
  canvas.create(image.size(), CV_8UC3);
  if (canvas.empty()) return false;
  copyAsBgr(image, canvas);
  canvas.convertTo(canvas, -1, share, offset);
  return true;
}

void drawDots(const FrameView& target, const MatchResult& result, Level level, int radius,
              cv::Mat& canvas) {
  for (const Correspondence& c : result.correspondences) {
    if (c.level != level) continue;
    const cv::Point2f& at = imagePoint(target.features, c.target_index);
    cv::circle(canvas, subpixel(at), radius << kFractionBits, colourOf(level, result.geometry),
               cv::FILLED, cv::LINE_AA, kFractionBits);
  }
}

/// Draws each final match: a line from the keypoint's position in the reference to its position in
/// the target, where a dot is drawn.
void drawStrokes(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 int stroke, cv::Mat& canvas) {
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktgp) continue;
    const cv::Point from = subpixel(imagePoint(reference.features, c.reference_index));
    const cv::Point to = subpixel(imagePoint(target.features, c.target_index));
    cv::line(canvas, from, to, colourOf(c.level, result.geometry), stroke, cv::LINE_AA,
             kFractionBits);
    cv::circle(canvas, to, stroke << kFractionBits, colourOf(c.level, result.geometry), cv::FILLED,
               cv::LINE_AA, kFractionBits);
  }
}

/// Maps the border of the reference image by the homography and draws it on the target. Draws
/// nothing if there is no homography.
void drawOutline(const cv::Size& reference_size, const MatchResult& result, int stroke,
                 cv::Mat& canvas) {
  if (result.homographyStatus() != Status::ok) return;
  const auto corners = homography::imageCorners(reference_size, {});
  const Eigen::Matrix3d view = homography::facing(result.answer.homography);
  std::vector<cv::Point> outline;
  for (const Eigen::Vector2d& corner :
       homography::partInView(view, corners, homography::kNearHorizon)) {
    const Eigen::Vector2d p = homography::project(view, corner);
    if (p.cwiseAbs().maxCoeff() > 1e6) return;  // outside the range of OpenCV's drawing functions
    outline.push_back(subpixel(p.x(), p.y()));
  }
  // Draw a wider black line first, so that the white line is visible on white parts of the image,
  // too.
  cv::polylines(canvas, outline, true, kBlack, stroke + 2, cv::LINE_AA, kFractionBits);
  cv::polylines(canvas, outline, true, kWhite, stroke, cv::LINE_AA, kFractionBits);
}

/// If the geometry is epipolar, draws the epipolar lines of a few final matches on the target. Lens
/// distortion bends the true lines, so a straight line may miss its match; such a line is not
/// drawn.
void drawEpipolarLines(const FrameView& reference, const FrameView& target,
                       const MatchResult& result, int stroke, cv::Mat& canvas) {
  constexpr std::size_t kLines = 8;
  constexpr double kMost = 3.0;  // px; largest distance of a line from its match
  if (result.geometry != Geometry::epipolar) return;
  const std::size_t count = countAtLeast(result.correspondences, Level::ktgp);
  std::size_t i = 0;
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktgp || !isChosen(i++, count, std::min(count, kLines))) continue;
    const cv::Point2f from = imagePoint(reference.features, c.reference_index);
    const cv::Point2f at = imagePoint(target.features, c.target_index);
    const Eigen::Vector3d line =
        result.two_view.view.fundamental * Eigen::Vector3d(from.x, from.y, 1.0);
    const Eigen::Vector2d normal = line.head<2>().normalized();
    const Eigen::Vector2d match(at.x, at.y);
    const double distance = line.dot(match.homogeneous()) / line.head<2>().norm();
    if (!(std::abs(distance) < kMost)) continue;
    // Draw the line across the whole canvas. Its middle is the point that is nearest to the match.
    const Eigen::Vector2d along =
        (canvas.cols + canvas.rows) * Eigen::Vector2d(-normal.y(), normal.x());
    const Eigen::Vector2d middle = match - distance * normal;
    const Eigen::Vector2d first = middle - along;
    const Eigen::Vector2d last = middle + along;
    cv::line(canvas, subpixel(first.x(), first.y()), subpixel(last.x(), last.y()), kWhite, stroke,
             cv::LINE_AA, kFractionBits);
  }
}

/// Draws the overlay of OverlayStyle::flow, without the panel.
void drawFlow(const FrameView& reference, const FrameView& target, const MatchResult& result,
              cv::Mat& canvas) {
  if (!drawDimmed(target.image, 0.7, 15.0, canvas)) return;
  const Typeface face(canvas.size());
  for (const Level level : {Level::knn, Level::kt, Level::ktg}) {
    drawDots(target, result, level, face.stroke(), canvas);
  }
  drawOutline(reference.image.size(), result, face.stroke(), canvas);
  drawEpipolarLines(reference, target, result, face.stroke(), canvas);
  drawStrokes(reference, target, result, face.stroke(), canvas);
}

/// Draws the reference on the left and the target on the right. The area below the shorter image
/// stays black.
void drawSideBySide(const cv::Mat& reference, const cv::Mat& target, cv::Mat& canvas) {
  canvas.create(std::max(reference.rows, target.rows), reference.cols + target.cols, CV_8UC3);
  canvas.setTo(cv::Scalar::all(0));
  if (!reference.empty()) copyAsBgr(reference, canvas(cv::Rect({0, 0}, reference.size())));
  if (!target.empty()) copyAsBgr(target, canvas(cv::Rect({reference.cols, 0}, target.size())));
}

/// Draws the reference and the target side by side, with dots for the matches that reached `level`.
/// At most 150 of these matches, evenly chosen, also get a line, because a thousand lines would
/// hide both images. `removed`: if true, matches below `level` get dots, too.
void drawMatches(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 Level level, bool removed, cv::Mat& canvas) {
  drawSideBySide(reference.image, target.image, canvas);
  const int stroke = Typeface(canvas.size()).stroke();
  const cv::Point2f offset(static_cast<float>(reference.image.cols), 0.F);
  const auto from = [&](const Correspondence& c) {
    return imagePoint(reference.features, c.reference_index);
  };
  const auto to = [&](const Correspondence& c) {
    return imagePoint(target.features, c.target_index) + offset;
  };
  const auto dots = [&](const Correspondence& c) {
    const auto dot = [&](const cv::Point2f& p) {
      cv::circle(canvas, p, stroke, colourOf(c.level, result.geometry), cv::FILLED, cv::LINE_AA);
    };
    if (c.reference_index >= 0) dot(from(c));
    dot(to(c));
  };

  constexpr std::size_t kMaxLines = 150;
  const std::size_t count = countAtLeast(result.correspondences, level);
  const std::size_t lines = std::min(count, kMaxLines);
  for (const Correspondence& c : result.correspondences) {
    if (c.level >= level || removed) dots(c);
  }
  std::size_t i = 0;
  for (const Correspondence& c : result.correspondences) {
    if (c.level < level || !isChosen(i++, count, lines)) continue;
    cv::line(canvas, from(c), to(c), colourOf(c.level, result.geometry), stroke, cv::LINE_AA);
  }
}

cv::Mat toGrey(const cv::Mat& image) {
  if (image.type() != CV_8UC3) return image;
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

/// cv::warpPerspective() refuses images with a side above 32766 px, so this function shrinks such
/// an image. Returns the homography from the shrunk image to the given one.
Eigen::Matrix3d shrinkForWarp(cv::Mat& image) {
  constexpr double kMostSide = 32766.0;  // px
  const Eigen::Vector2d size(image.cols, image.rows);
  const double scale = kMostSide / size.maxCoeff();
  if (scale >= 1.0) return Eigen::Matrix3d::Identity();
  cv::resize(image, image, {}, scale, scale, cv::INTER_AREA);
  // resize() rounds the size, and keeps the borders of the pixels in place, not their centres.
  const Eigen::Vector2d by = size.cwiseQuotient(Eigen::Vector2d(image.cols, image.rows));
  const Eigen::Vector2d shift = 0.5 * (by - Eigen::Vector2d::Ones());
  return (Eigen::Translation2d(shift) * Eigen::Scaling(by.x(), by.y())).matrix();
}

/// Draws the overlay of OverlayStyle::difference, without the panel. First adjusts the mean and
/// contrast of the warped reference to the target; each grey value is then 128 + (target - warped
/// reference) / 2. Shows the darkened target where the warped reference does not cover it, or
/// everywhere if there is no homography.
void drawDifference(const FrameView& reference, const FrameView& target, const MatchResult& result,
                    cv::Mat& canvas) {
  if (!drawDimmed(target.image, 0.3, 0.0, canvas)) return;
  if (result.homographyStatus() != Status::ok || reference.image.empty()) return;

  cv::Mat source = toGrey(reference.image);
  const Eigen::Matrix3d from_source = result.answer.homography * shrinkForWarp(source);
  cv::Mat homography;
  cv::eigen2cv(from_source, homography);
  const cv::Mat grey = toGrey(target.image);
  cv::Mat warped;
  cv::Mat covered;
  cv::warpPerspective(source, warped, homography, grey.size(), cv::INTER_LINEAR);
  cv::warpPerspective(cv::Mat(source.size(), CV_8UC1, cv::Scalar(255)), covered, homography,
                      grey.size(), cv::INTER_NEAREST);

  cv::Scalar target_mean;
  cv::Scalar target_deviation;
  cv::Scalar warped_mean;
  cv::Scalar warped_deviation;
  cv::meanStdDev(grey, target_mean, target_deviation, covered);
  cv::meanStdDev(warped, warped_mean, warped_deviation, covered);
  const double gain =
      std::clamp(target_deviation[0] / std::max(warped_deviation[0], 1.0), 0.25, 4.0);
  cv::Mat difference;
  cv::addWeighted(grey, 0.5, warped, -0.5 * gain,
                  128.0 - 0.5 * (target_mean[0] - gain * warped_mean[0]), difference);
  cv::Mat shown;
  cv::cvtColor(difference, shown, cv::COLOR_GRAY2BGR);
  shown.copyTo(canvas, covered);
}

/// The part of the headline about the two-view geometry: the parallax, and the doubt, if any.
std::string motionText(const MatchResult& result) {
  const TwoView& view = result.two_view.view;
  std::string text;
  if (view.geometry != Geometry::none && std::isfinite(view.parallax)) {
    text = format("  parallax %.1f deg", view.parallax);
  }
  if (view.doubt == Doubt::none) return text;
  return text + "  doubt: " + toString(view.doubt) +
         (view.other ? format(" (%.2f)", view.probability) : "");
}

std::string headline(const MatchResult& result, const cv::Size& reference_size) {
  const bool two_view = result.stage(StageId::two_view) != nullptr;
  const bool found = result.status == Status::ok;
  std::string text =
      format("%s  %.1f ms", two_view && found ? toString(result.geometry) : toString(result.status),
             result.milliseconds()) +
      motionText(result);
  if (result.homographyStatus() != Status::ok) return text;
  const double deviation =
      homography::cornerDeviation(result.answer.homography, result.answer.covariance,
                                  homography::imageCorners(reference_size, {}))
          .target;
  if (!std::isfinite(deviation)) return text;
  text += format("  corners +-%.*f px", deviation < 10.0 ? 2 : 0, deviation);
  if (result.answer.plane_deviation > 0.0) {
    text += format("  plane %.2f px", result.answer.plane_deviation);
  }
  return text;
}

/// Draws the panel on the left side. It begins at row `top`, or at row 0 if it does not fit below
/// `top`. It shows the status, the time in milliseconds and the standard deviation of the corners.
/// For each stage, it shows a label, the number of matches that got no further, and a bar in the
/// colour of the stage. `reference_size`: size of the reference image, px.
void drawPanel(const MatchResult& result, const cv::Size& reference_size, int top,
               cv::Mat& canvas) {
  const Typeface face(canvas.size());
  const int line = face.lineHeight();
  const int margin = line / 3;
  constexpr std::array<const char*, 4> kLabels{"- ratio", "- GMS", "- PROSAC", "final"};
  std::array<std::size_t, 4> counts{};  // number of matches that ended at each level
  for (const Correspondence& c : result.correspondences) {
    ++counts[std::min<std::size_t>(static_cast<std::size_t>(c.level), counts.size() - 1)];
  }
  // result.inliers also counts the guided matches, which are not in `correspondences`.
  if (result.status == Status::ok) counts.back() = result.inliers;
  const double total = static_cast<double>(std::max<std::size_t>(result.correspondences.size(), 1));

  const std::string title = headline(result, reference_size);
  const int label_width = face.width(kLabels[static_cast<std::size_t>(Level::ktg)]) + margin;
  const int count_width = face.width("0000000");
  const int bar_start = 2 * margin + label_width + count_width;
  const int width = std::max(face.width(title) + 2 * margin, bar_start + 3 * line);
  const int height = 5 * line + 2 * margin;
  if (top + height > canvas.rows) top = 0;
  darken(canvas, {0, top, width, height});
  face.draw(canvas, title, {margin, top + margin});
  int y = top + margin + line;
  for (const Level level : {Level::ktgp, Level::ktg, Level::kt, Level::knn}) {
    const std::size_t count = counts[static_cast<std::size_t>(level)];
    const std::string number = std::to_string(count);
    face.draw(canvas, kLabels[static_cast<std::size_t>(level)], {margin, y});
    face.draw(canvas, number, {bar_start - margin - face.width(number), y});
    const int longest = width - margin - bar_start;
    const int length =
        std::max(2, static_cast<int>(std::lround(longest * static_cast<double>(count) / total)));
    cv::rectangle(canvas, cv::Rect(bar_start, y + line / 4, length, line / 2),
                  colourOf(level, result.geometry), cv::FILLED);
    y += line;
  }
}

/// Draws a line of text along the upper border, on a darkened strip.
void drawTitle(const std::string& text, cv::Mat& canvas) {
  const Typeface face(canvas.size());
  const int margin = face.lineHeight() / 3;
  darken(canvas, {0, 0, canvas.cols, face.lineHeight() + 2 * margin});
  face.draw(canvas, text, {margin, margin});
}

}  // namespace
}  // namespace overlay

const char* toString(OverlayStyle style) {
  return util::nameOf<OverlayStyle::difference>(style, {"flow", "side_by_side", "difference"});
}

void drawOverlay(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 OverlayStyle style, cv::Mat& canvas) {
  switch (style) {
    case OverlayStyle::flow:
      overlay::drawFlow(reference, target, result, canvas);
      break;
    case OverlayStyle::side_by_side: {
      overlay::drawMatches(reference, target, result, Level::ktgp, true, canvas);
      cv::Mat right = canvas(cv::Rect({reference.image.cols, 0}, target.image.size()));
      const int stroke = overlay::Typeface(canvas.size()).stroke();
      overlay::drawOutline(reference.image.size(), result, stroke, right);
      overlay::drawEpipolarLines(reference, target, result, stroke, right);
      break;
    }
    case OverlayStyle::difference:
      overlay::drawDifference(reference, target, result, canvas);
      break;
  }
  // In the style side_by_side, there is free space below a reference that is shorter than the
  // target: put the panel there.
  const int top = style == OverlayStyle::side_by_side ? reference.image.rows : 0;
  overlay::drawPanel(result, reference.image.size(), top, canvas);
}

void drawUnmatched(const cv::Mat& target, const std::string& reason, cv::Mat& canvas) {
  if (overlay::drawDimmed(target, 0.7, 15.0, canvas)) overlay::drawTitle(reason, canvas);
}

void drawLevel(const FrameView& reference, const FrameView& target, const MatchResult& result,
               Level level, cv::Mat& canvas) {
  overlay::drawMatches(reference, target, result, level, false, canvas);
}

void drawStages(const FrameView& reference, const FrameView& target, const MatchResult& result,
                cv::Mat& canvas) {
  const char* const names[] = {"(a) KNN", "(b) KNN+TF", "(c) KNN+TF+GMS", "(d) KNN+TF+GMS+PROSAC"};
  constexpr int kGap = 8;  // gap between panels, px
  cv::Mat panel;
  for (int i = 0; i < 4; ++i) {
    const auto level = static_cast<Level>(i);
    drawLevel(reference, target, result, level, panel);
    overlay::drawTitle(std::string(names[i]) + ": " +
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
