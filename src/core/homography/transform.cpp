#include "core/homography/transform.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

Eigen::Vector2d project(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point) {
  return (homography * point.homogeneous()).hnormalized();
}

Eigen::Matrix<double, 2, 8> jacobianByEntries(const Eigen::Matrix3d& homography,
                                              const Eigen::Vector2d& point) {
  const Eigen::Vector3d p = homography * point.homogeneous();
  const Eigen::Vector2d q = p.hnormalized();
  const double x = point.x() / p.z();
  const double y = point.y() / p.z();
  Eigen::Matrix<double, 2, 8> jacobian;
  jacobian << x, y, 1.0 / p.z(), 0.0, 0.0, 0.0, -q.x() * x, -q.x() * y,  //
      0.0, 0.0, 0.0, x, y, 1.0 / p.z(), -q.y() * x, -q.y() * y;
  return jacobian;
}

Eigen::Matrix2d jacobianByPoint(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point) {
  const Eigen::Vector3d p = homography * point.homogeneous();
  return (homography.topLeftCorner<2, 2>() - p.hnormalized() * homography.block<1, 2>(2, 0)) /
         p.z();
}

bool scaleLastToOne(Eigen::Matrix3d& homography) {
  constexpr double kNearZero = 1e-9;  // of H's length
  const bool possible = std::abs(homography(2, 2)) > kNearZero * homography.norm();
  homography /= possible ? homography(2, 2) : homography.norm();
  return possible;
}

std::array<Eigen::Vector2d, 4> imageCorners(const cv::Size& size,
                                            const std::vector<Eigen::Vector2d>& points) {
  Eigen::AlignedBox2d box;
  if (size.width > 0 && size.height > 0) {
    box.extend(Eigen::Vector2d::Zero());
    box.extend(Eigen::Vector2d(size.width - 1.0, size.height - 1.0));
  } else {
    for (const Eigen::Vector2d& p : points) box.extend(p);
  }
  using Box = Eigen::AlignedBox2d;
  return {box.corner(Box::BottomLeft), box.corner(Box::BottomRight), box.corner(Box::TopRight),
          box.corner(Box::TopLeft)};
}

bool keepsPlaneInView(const Eigen::Matrix3d& homography,
                      const std::array<Eigen::Vector2d, 4>& corners) {
  constexpr double kClear = 1e-3;  // ratio of the nearest to the farthest third coordinate
  double nearest = homography.row(2).dot(corners[0].homogeneous());
  double farthest = nearest;
  for (const Eigen::Vector2d& corner : corners) {
    const double w = homography.row(2).dot(corner.homogeneous());
    nearest = std::min(nearest, w);
    farthest = std::max(farthest, w);
  }
  return homography.determinant() > 0.0 && nearest > kClear * farthest;
}

Eigen::Matrix3d resizing(const cv::Size& from, const cv::Size& to) {
  const double x = static_cast<double>(to.width) / from.width;
  const double y = static_cast<double>(to.height) / from.height;
  Eigen::Matrix3d map = Eigen::Matrix3d::Identity();
  map(0, 0) = x;
  map(1, 1) = y;
  map(0, 2) = 0.5 * x - 0.5;
  map(1, 2) = 0.5 * y - 0.5;
  return map;
}

double overlap(const Eigen::Matrix3d& homography, const cv::Size& size) {
  const double w = size.width;
  const double h = size.height;
  const std::array<cv::Point2f, 4> image{cv::Point2f(0.F, 0.F), cv::Point2f(float(w), 0.F),
                                         cv::Point2f(float(w), float(h)),
                                         cv::Point2f(0.F, float(h))};
  std::array<cv::Point2f, 4> warped;
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector3d p = homography * Eigen::Vector3d(image[i].x, image[i].y, 1.0);
    if (p.z() <= 0.0) return 0.0;  // a corner beyond the horizon
    warped[i] = {static_cast<float>(p.x() / p.z()), static_cast<float>(p.y() / p.z())};
  }
  return cv::intersectConvexConvex(image, warped, cv::noArray()) / (w * h);
}

}  // namespace ktgp_orb::homography

namespace ktgp_orb {

double reprojectionError(const Eigen::Matrix3d& homography, const Eigen::Vector2d& reference,
                         const Eigen::Vector2d& target) {
  return ktgp_orb::homography::errorOf(homography, reference, target);
}

}  // namespace ktgp_orb
