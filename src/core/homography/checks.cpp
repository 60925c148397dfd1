#include "core/homography/checks.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace ktgp_orb {

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
  constexpr double kClear = 1e-3;  // nearest over farthest, as the third coordinate has it
  double nearest = homography.row(2).dot(corners[0].homogeneous());
  double farthest = nearest;
  for (const Eigen::Vector2d& corner : corners) {
    const double w = homography.row(2).dot(corner.homogeneous());
    nearest = std::min(nearest, w);
    farthest = std::max(farthest, w);
  }
  return homography.determinant() > 0.0 && nearest > kClear * farthest;
}

CornerDeviation cornerDeviation(const Eigen::Matrix3d& homography,
                                const Eigen::Matrix<double, 8, 8>& covariance,
                                const std::array<Eigen::Vector2d, 4>& corners) {
  const auto root = [](double variance) {
    return variance >= 0.0 ? std::sqrt(variance) : std::numeric_limits<double>::infinity();
  };
  CornerDeviation largest;
  for (const Eigen::Vector2d& corner : corners) {
    const Eigen::Vector3d p = homography * corner.homogeneous();
    const Eigen::Vector2d q = p.hnormalized();
    const double x = corner.x() / p.z();
    const double y = corner.y() / p.z();
    Eigen::Matrix<double, 2, 8> by_entries;
    by_entries << x, y, 1.0 / p.z(), 0.0, 0.0, 0.0, -q.x() * x, -q.x() * y,  //
        0.0, 0.0, 0.0, x, y, 1.0 / p.z(), -q.y() * x, -q.y() * y;
    const Eigen::Matrix2d by_corner =
        (homography.topLeftCorner<2, 2>() - q * homography.block<1, 2>(2, 0)) / p.z();
    const Eigen::Matrix2d spread = by_entries * covariance * by_entries.transpose();
    const Eigen::Matrix2d back = by_corner.inverse();
    largest.target = std::max(largest.target, root(spread.trace()));
    largest.reference =
        std::max(largest.reference, root((back * spread * back.transpose()).trace()));
  }
  return largest;
}

}  // namespace ktgp_orb
