#include "ktgp_orb/lens.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <stdexcept>
#include <string>

#include "util/camera_check.h"
#include "util/constants.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

bool isFinite(const cv::Matx33d& matrix) {
  return std::all_of(matrix.val, matrix.val + 9, [](double x) { return std::isfinite(x); });
}

/// Throws if OpenCV's lens models cannot use the camera matrix; for example, they ignore skew. The
/// principal point may be outside the image, because the image may be a part (roi) of a larger
/// image.
void requireLensCamera(const std::string& name, const cv::Matx33d& camera, const cv::Size& image) {
  // Largest |cx| and |cy|, measured from the image's corner, as a multiple of width and height.
  constexpr double kFarthest = 10.0;
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
  constexpr double kRounding = 1e-3;  // tolerance, since calibration files have few digits
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

// With OpenCV's default of five iterations, undistorted points near the corners of a wide lens
// would be wrong by whole pixels.
const cv::TermCriteria kUntil(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-4);

std::vector<cv::Point2d> raysOf(const LensCalibration& c, const std::vector<cv::Point2d>& pixels) {
  std::vector<cv::Point2d> rays;
  if (c.model == LensModel::equidistant) {
    cv::fisheye::undistortPoints(pixels, rays, c.camera, c.distortion);
  } else {
    cv::undistortPoints(pixels, rays, c.camera, c.distortion, cv::noArray(), cv::noArray(), kUntil);
  }
  return rays;
}

/// Maps rays (x, y, 1) to pixels.
std::vector<cv::Point2d> pixelsOf(const LensCalibration& c, const std::vector<cv::Point2d>& rays) {
  std::vector<cv::Point2d> pixels;
  if (c.model == LensModel::equidistant) {
    cv::fisheye::distortPoints(rays, pixels, c.camera, c.distortion);
    return pixels;
  }
  std::vector<cv::Point3d> points;
  points.reserve(rays.size());
  for (const cv::Point2d& ray : rays) points.emplace_back(ray.x, ray.y, 1.0);
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), c.camera, c.distortion, pixels);
  return pixels;
}

constexpr double kNear = 1.0;  // px

/// Throws if the distortion cannot be inverted near the middle of the image. With a right
/// calibration, this is always possible.
void requireInverse(const LensCalibration& c) {
  // Distance of the test point from the principal point, as a share of the image size.
  constexpr double kShare = 0.125;
  const std::vector<cv::Point2d> pixels{{c.camera(0, 2) + kShare * c.image_size.width,
                                         c.camera(1, 2) + kShare * c.image_size.height}};
  if (cv::norm(pixelsOf(c, raysOf(c, pixels))[0] - pixels[0]) < kNear) return;
  throw std::invalid_argument(
      "the distortion of the lens cannot be undone even near the middle of the image; expected the "
      "coefficients (D) of a calibration");
}

// Points farther than this from the axis of a fisheye are not used. At 60 degrees, one pixel covers
// 1 / cos² = 4 px of the undistorted image, which is more than the inlier threshold; at 75 degrees,
// it covers 15 px. We tested the preset slam on 8 image pairs of a camera with a 200-degree lens
// that only turned. With points up to 60 degrees, it was certain of the pure turn in all 8 pairs;
// with points up to 75 degrees, only in 2 pairs.
constexpr double kFarthestAngle = 60.0 * util::kPi / 180.0;

/// Largest angle, rad, up to which the distance from the principal point increases with the angle.
double rangeOf(const LensCalibration& c) {
  constexpr int kSteps = 300;
  std::vector<cv::Point2d> rays;
  rays.reserve(kSteps + 1);
  for (int i = 0; i <= kSteps; ++i) rays.emplace_back(std::tan(kFarthestAngle * i / kSteps), 0.0);
  const std::vector<cv::Point2d> pixels = pixelsOf(c, rays);
  int last = 1;
  while (last < kSteps &&
         pixels[static_cast<std::size_t>(last) + 1].x > pixels[static_cast<std::size_t>(last)].x) {
    ++last;
  }
  return kFarthestAngle * last / kSteps;
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
  const std::vector<cv::Point2d> rays = raysOf(c, points);
  const std::vector<cv::Point2d> back = pixelsOf(c, rays);
  constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();
  const double range = rangeOf(c);
  const double least = std::cos(kFarthestAngle);
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    const cv::Vec3d turned = c.rotation * cv::Vec3d(rays[i].x, rays[i].y, 1.0);
    const bool is_in_range = std::atan(cv::norm(rays[i])) < range &&
                             cv::norm(back[i] - points[i]) < kNear &&
                             turned[2] > least * cv::norm(turned);
    const cv::Vec3d p = c.rectified_camera * turned;
    keypoints[i].pt = is_in_range ? cv::Point2f(cv::Point2d(p[0] / p[2], p[1] / p[2]))
                                  : cv::Point2f(kNowhere, kNowhere);
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
