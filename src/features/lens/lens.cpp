#include "ktgp_orb/lens.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <stdexcept>
#include <string>

#include "util/camera_check.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

bool isFinite(const cv::Matx33d& matrix) {
  return std::all_of(matrix.val, matrix.val + 9, [](double x) { return std::isfinite(x); });
}

/// OpenCV's models have no skew, and would ignore it. A part of an image (roi) need not contain the
/// principal point.
void requireLensCamera(const std::string& name, const cv::Matx33d& camera, const cv::Size& image) {
  constexpr double kFarthest = 10.0;  // sides of the image
  util::requireK(name, camera, image);
  if (camera(0, 1) != 0.0) {
    throw std::invalid_argument(name + " has skew, " + std::to_string(camera(0, 1)) +
                                "; expected none");
  }
  if (image.empty()) return;
  const double width = kFarthest * image.width;
  const double height = kFarthest * image.height;
  util::requireInRange("cx of " + name, camera(0, 2), -width, width);
  util::requireInRange("cy of " + name, camera(1, 2), -height, height);
}

void requireRotation(const cv::Matx33d& rotation) {
  constexpr double kRounding = 1e-3;  // calibration files have few digits
  if (!isFinite(rotation)) throw std::invalid_argument("the rectifying rotation is not finite");
  if (cv::norm(rotation * rotation.t() - cv::Matx33d::eye()) < kRounding &&
      cv::determinant(rotation) > 0.0) {
    return;
  }
  throw std::invalid_argument(
      "the rectifying rotation is no rotation matrix; expected R of a calibration");
}

void requireCoefficients(const LensCalibration& calibration) {
  static const std::set<std::size_t> radial_tangential{0, 4, 5, 8, 12, 14};
  const std::vector<double>& d = calibration.distortion;
  const bool equidistant = calibration.model == LensModel::equidistant;
  if (equidistant ? d.size() != 4 : radial_tangential.count(d.size()) == 0) {
    throw std::invalid_argument("the lens has " + std::to_string(d.size()) +
                                " distortion coefficients; expected " +
                                (equidistant ? "4" : "0, 4, 5, 8, 12 or 14"));
  }
  if (!std::all_of(d.begin(), d.end(), [](double x) { return std::isfinite(x); })) {
    throw std::invalid_argument("a distortion coefficient of the lens is not finite");
  }
}

// OpenCV's default of five iterations leaves errors of whole pixels near the corners of a wide
// lens.
const cv::TermCriteria kUntil(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-4);

/// Near the middle, any lens that was calibrated can be undone.
void requireInverse(const LensCalibration& c) {
  constexpr double kShare = 0.125;  // share of the image size, from the principal point
  constexpr double kNear = 1.0;     // px
  const std::vector<cv::Point2d> pixels{{c.camera(0, 2) + kShare * c.image_size.width,
                                         c.camera(1, 2) + kShare * c.image_size.height}};
  std::vector<cv::Point2d> rays;
  std::vector<cv::Point2d> back;
  if (c.model == LensModel::equidistant) {
    cv::fisheye::undistortPoints(pixels, rays, c.camera, c.distortion);
    cv::fisheye::distortPoints(rays, back, c.camera, c.distortion);
  } else {
    cv::undistortPoints(pixels, rays, c.camera, c.distortion, cv::noArray(), cv::noArray(), kUntil);
    const std::vector<cv::Point3d> points{{rays[0].x, rays[0].y, 1.0}};
    cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), c.camera, c.distortion, back);
  }
  if (cv::norm(back[0] - pixels[0]) < kNear) return;
  throw std::invalid_argument(
      "the distortion of the lens cannot be undone even near the middle of the image; expected the "
      "coefficients (D) of a calibration");
}

}  // namespace

bool LensCalibration::operator==(const LensCalibration& other) const {
  return model == other.model && image_size == other.image_size && camera == other.camera &&
         distortion == other.distortion && rotation == other.rotation &&
         rectified_camera == other.rectified_camera;
}

Lens::Lens(const LensCalibration& calibration) : calibration_(calibration) {
  requireLensCamera("the camera matrix", calibration.camera, calibration.image_size);
  requireLensCamera("the rectified camera matrix", calibration.rectified_camera,
                    calibration.image_size);
  requireCoefficients(calibration);
  requireRotation(calibration.rotation);
  requireInverse(calibration);
}

void Lens::rectify(std::vector<cv::KeyPoint>& keypoints) const {
  if (keypoints.empty()) return;
  const LensCalibration& c = calibration_;
  std::vector<cv::Point2d> points;
  points.reserve(keypoints.size());
  for (const cv::KeyPoint& keypoint : keypoints) points.emplace_back(keypoint.pt);
  std::vector<cv::Point2d> rectified;
  if (c.model == LensModel::equidistant) {
    cv::fisheye::undistortPoints(points, rectified, c.camera, c.distortion, c.rotation,
                                 c.rectified_camera);
  } else {
    cv::undistortPoints(points, rectified, c.camera, c.distortion, c.rotation, c.rectified_camera,
                        kUntil);
  }
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    const cv::Point2d& point = rectified[i];
    // If no ray through the lens leads to a point, the point stays where it is: a few more wrong
    // matches.
    if (std::isfinite(point.x) && std::isfinite(point.y)) keypoints[i].pt = point;
  }
}

void Lens::rectify(const cv::Mat& image, cv::Mat& rectified) const {
  const LensCalibration& c = calibration_;
  cv::Mat map_x;
  cv::Mat map_y;
  if (c.model == LensModel::equidistant) {
    cv::fisheye::initUndistortRectifyMap(c.camera, c.distortion, c.rotation, c.rectified_camera,
                                         image.size(), CV_32F, map_x, map_y);
  } else {
    cv::initUndistortRectifyMap(c.camera, c.distortion, c.rotation, c.rectified_camera,
                                image.size(), CV_32F, map_x, map_y);
  }
  cv::remap(image, rectified, map_x, map_y, cv::INTER_LINEAR);
}

}  // namespace ktgp_orb
