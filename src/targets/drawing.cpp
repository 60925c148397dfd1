#include <opencv2/imgproc.hpp>

#include "ktgp_orb/target_finder.h"
#include "overlay/canvas.h"

namespace ktgp_orb {
namespace {

constexpr int kFractionBits = 4;   // OpenCV gets coordinates in sixteenths of a pixel
constexpr double kFarthest = 1e5;  // px; a target with a corner farther out is not drawn

std::vector<cv::Point> outlineOf(const DetectedTarget& detection) {
  std::vector<cv::Point> outline;
  for (const Eigen::Vector2d& corner : detection.corners) {
    if (!(corner.cwiseAbs().maxCoeff() < kFarthest)) return {};
    outline.emplace_back(cvRound(corner.x() * (1 << kFractionBits)),
                         cvRound(corner.y() * (1 << kFractionBits)));
  }
  return outline;
}

}  // namespace

void drawTargets(const cv::Mat& image, const std::vector<DetectedTarget>& detections,
                 cv::Mat& canvas) {
  canvas.create(image.size(), CV_8UC3);
  overlay::copyAsBgr(image, canvas);
  const overlay::Typeface face(canvas.size());
  for (const DetectedTarget& detection : detections) {
    const std::vector<cv::Point> outline = outlineOf(detection);
    if (outline.empty()) continue;
    const bool found = detection.status == Status::ok;
    const cv::Scalar& colour = overlay::colourOf(found ? Level::ktgp : Level::ktg, Geometry::plane);
    cv::polylines(canvas, outline, true, overlay::kBlack, face.stroke() + 2, cv::LINE_AA,
                  kFractionBits);
    cv::polylines(canvas, outline, true, colour, face.stroke(), cv::LINE_AA, kFractionBits);
    // A short line marks the upper left corner.
    cv::line(canvas, outline[0], (outline[0] * 3 + outline[2]) / 4, colour, face.stroke(),
             cv::LINE_AA, kFractionBits);
    const std::string text = detection.id + " " + std::to_string(detection.instance);
    const Eigen::Vector2d middle = 0.25 * (detection.corners[0] + detection.corners[1] +
                                           detection.corners[2] + detection.corners[3]);
    const cv::Point corner(cvRound(middle.x()) - face.width(text) / 2,
                           cvRound(middle.y()) - face.lineHeight() / 2);
    overlay::darken(canvas, cv::Rect(corner, cv::Size(face.width(text), face.lineHeight())) &
                                cv::Rect(cv::Point(), canvas.size()));
    face.draw(canvas, text, corner);
  }
}

}  // namespace ktgp_orb
