#include "overlay/styles.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "core/homography/transform.h"
#include "core/util/keypoint_position.h"
#include "overlay/canvas.h"
#include "overlay/palette.h"
#include "overlay/text.h"

namespace ktgp_orb::overlay {
namespace {

using util::imagePoint;

// Positions have a resolution of a sixteenth of a pixel, so that slow motion does not jump.
constexpr int kFractionBits = 4;

cv::Point subpixel(double x, double y) {
  constexpr double kUnit = 1 << kFractionBits;
  return {cvRound(x * kUnit), cvRound(y * kUnit)};
}

cv::Point subpixel(const cv::Point2f& p) {
  return subpixel(p.x, p.y);
}

void drawDots(const FrameView& target, const MatchResult& result, Level level, int radius,
              cv::Mat& canvas) {
  for (const Correspondence& c : result.correspondences) {
    if (c.level != level) continue;
    const cv::Point2f& at = imagePoint(target.features, c.target_index);
    cv::circle(canvas, subpixel(at), radius << kFractionBits, lookOf(level, result.geometry).colour,
               cv::FILLED, cv::LINE_AA, kFractionBits);
  }
}

/// A stroke from the old position of a final match to the new one, which has a dot.
void drawStrokes(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 int stroke, cv::Mat& canvas) {
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktgp) continue;
    const cv::Point from = subpixel(imagePoint(reference.features, c.reference_index));
    const cv::Point to = subpixel(imagePoint(target.features, c.target_index));
    cv::line(canvas, from, to, lookOf(c.level, result.geometry).colour, stroke, cv::LINE_AA,
             kFractionBits);
    cv::circle(canvas, to, stroke << kFractionBits, lookOf(c.level, result.geometry).colour,
               cv::FILLED, cv::LINE_AA, kFractionBits);
  }
}

}  // namespace

void drawOutline(const cv::Size& reference_size, const MatchResult& result, int stroke,
                 cv::Mat& canvas) {
  if (result.status != Status::ok) return;
  const auto corners = homography::imageCorners(reference_size, {});
  if (!homography::keepsPlaneInView(result.answer.homography, corners)) return;
  std::vector<cv::Point> outline;
  for (const Eigen::Vector2d& corner : corners) {
    const Eigen::Vector2d p = (result.answer.homography * corner.homogeneous()).hnormalized();
    if (p.cwiseAbs().maxCoeff() > 1e6) return;  // beyond the range of OpenCV's drawing
    outline.push_back(subpixel(p.x(), p.y()));
  }
  cv::polylines(canvas, outline, true, kBlack, stroke + 2, cv::LINE_AA, kFractionBits);
  cv::polylines(canvas, outline, true, kWhite, stroke, cv::LINE_AA, kFractionBits);
}

void drawEpipolarLines(const FrameView& reference, const FrameView& target,
                       const MatchResult& result, int stroke, cv::Mat& canvas) {
  constexpr std::size_t kLines = 8;
  constexpr double kMost = 3.0;  // px between a line and its match
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
    // Drawn from one side of the canvas to the other, through the point of the line at the match.
    const Eigen::Vector2d along =
        (canvas.cols + canvas.rows) * Eigen::Vector2d(-normal.y(), normal.x());
    const Eigen::Vector2d middle = match - distance * normal;
    const Eigen::Vector2d first = middle - along;
    const Eigen::Vector2d last = middle + along;
    cv::line(canvas, subpixel(first.x(), first.y()), subpixel(last.x(), last.y()), kWhite, stroke,
             cv::LINE_AA, kFractionBits);
  }
}

void drawFlow(const FrameView& reference, const FrameView& target, const MatchResult& result,
              cv::Mat& canvas) {
  canvas.create(target.image.size(), CV_8UC3);
  if (canvas.empty()) return;
  copyAsBgr(target.image, canvas);
  canvas.convertTo(canvas, -1, 0.7,
                   15.0);  // a dark outline keeps white strokes visible on white
  const Typeface face(canvas.size());
  for (const Level level : {Level::knn, Level::kt, Level::ktg}) {
    drawDots(target, result, level, face.stroke(), canvas);
  }
  drawOutline(reference.image.size(), result, face.stroke(), canvas);
  drawEpipolarLines(reference, target, result, face.stroke(), canvas);
  drawStrokes(reference, target, result, face.stroke(), canvas);
}

}  // namespace ktgp_orb::overlay
