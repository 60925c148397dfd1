#include "mosaic/surface.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

#include "homography/transform.h"

namespace ktgp_orb::mosaic {
namespace {

/// Returns true if the frame can be drawn into a map on the plane of the first frame.
bool planeCanShow(const cv::Size& size, const Eigen::Matrix3d& from_map) {
  const Eigen::Matrix3d inverse = from_map.inverse();
  const Eigen::Matrix3d to_map = inverse / inverse(2, 2);
  if (!to_map.allFinite() ||
      !homography::keepsPlaneInView(to_map, homography::imageCorners(size, {})))
    return false;
  const auto corners = Surface().outline(size, inverse);
  double shortest = 1e18;
  double longest = 0.0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const double side = (corners[(i + 1) % 4] - corners[i]).norm();
    const double of_frame = i % 2 == 0 ? size.width - 1.0 : size.height - 1.0;
    shortest = std::min(shortest, side / of_frame);
    longest = std::max(longest, side / of_frame);
  }
  return shortest > 1.0 / kLargestZoom && longest < kLargestZoom;
}

}  // namespace

// Fits the rotation to points of the frame and not to the entries of the matrix K_inv H K (H:
// `from_map`; K: `camera`), because the last row of this matrix is much less accurate than the
// other rows.
TurnFit fitTurn(const Eigen::Matrix3d& from_map, const Eigen::Matrix3d& camera,
                const cv::Size& size) {
  constexpr int kGrid = 3;
  const double side = from_map.determinant() < 0.0 ? -1.0 : 1.0;
  const Eigen::Matrix3d to_ray = camera.inverse();
  const Eigen::Matrix3d to_map = side * to_ray * from_map.inverse();
  Eigen::Matrix<double, 2, kGrid * kGrid> pixels;
  // Viewing rays of `pixels`, in the coordinates of the first camera.
  Eigen::Matrix<double, 3, kGrid * kGrid> rays;
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const int column = i % kGrid;
    const int row = i / kGrid;
    const double x = 0.5 * column * (size.width - 1);
    const double y = 0.5 * row * (size.height - 1);
    pixels.col(i) << x, y;
    const Eigen::Vector3d pixel(x, y, 1.0);
    rays.col(i) = (to_map * pixel).normalized();
    sum += (to_ray * pixel).normalized() * rays.col(i).transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d turned = svd.matrixU() * svd.matrixV().transpose();
  const Eigen::Vector3d proper(1.0, 1.0, turned.determinant() < 0.0 ? -1.0 : 1.0);
  TurnFit fit;
  fit.rotation = svd.matrixU() * proper.asDiagonal() * svd.matrixV().transpose();
  const auto seen = (camera * fit.rotation * rays).eval();
  const bool is_ahead = seen.allFinite() && seen.row(2).minCoeff() > 0.0;
  fit.off = is_ahead ? (seen.colwise().hnormalized() - pixels).norm() / kGrid
                     : std::numeric_limits<double>::infinity();
  return fit;
}

Surface::Surface(const Eigen::Matrix3d& camera, const Eigen::Vector3d& axis)
    : camera_(camera), period_(2.0 * M_PI * camera(0, 0)) {
  // Viewing direction of the first frame, made perpendicular to the axis.
  const Eigen::Vector3d ahead = (Eigen::Vector3d::UnitZ() - axis.z() * axis).normalized();
  Eigen::Matrix3d rows;
  rows << axis.cross(ahead).transpose(), axis.transpose(), ahead.transpose();
  to_axis_ = rows * camera.inverse();
  from_axis_ = camera * rows.transpose();
}

Eigen::Vector2d Surface::toMap(const Eigen::Vector3d& point) const {
  if (isPlane()) return point.hnormalized();
  const Eigen::Vector3d ray = to_axis_ * point;
  const Eigen::Vector2d place(std::atan2(ray.x(), ray.z()), ray.y() / std::hypot(ray.x(), ray.z()));
  return camera_.topRightCorner<2, 1>() + camera_(0, 0) * place;
}

Eigen::Vector3d Surface::fromMap(const Eigen::Vector2d& place) const {
  if (isPlane()) return place.homogeneous();
  const Eigen::Vector2d p = (place - camera_.topRightCorner<2, 1>()) / camera_(0, 0);
  return from_axis_ * Eigen::Vector3d(std::sin(p.x()), p.y(), std::cos(p.x()));
}

Eigen::Vector2d Surface::near(const Eigen::Vector2d& place, const Eigen::Vector2d& other) const {
  if (isPlane()) return place;
  return {place.x() + period_ * std::round((other.x() - place.x()) / period_), place.y()};
}

Eigen::Matrix3d Surface::scaled(const Eigen::Matrix3d& homography) const {
  if (isPlane()) return homography / homography(2, 2);
  return homography / std::cbrt(homography.determinant());
}

Eigen::Matrix3d Surface::fitted(const Eigen::Matrix3d& from_map, const cv::Size& size) const {
  if (isPlane()) return scaled(from_map);
  return camera_ * fitTurn(from_map, camera_, size).rotation * camera_.inverse();
}

double Surface::off(const Eigen::Matrix3d& from_map, const cv::Size& size) const {
  return isPlane() ? 0.0 : fitTurn(from_map, camera_, size).off;
}

Eigen::Vector2d Surface::inFrame(const Eigen::Matrix3d& from_map,
                                 const Eigen::Vector2d& place) const {
  const Eigen::Vector3d p = from_map * fromMap(place);
  constexpr double kNowhere = std::numeric_limits<double>::infinity();
  if (!isPlane() && p.z() <= 0.0) return Eigen::Vector2d::Constant(kNowhere);
  return p.hnormalized();
}

bool Surface::canShow(const cv::Size& size, const Eigen::Matrix3d& from_map) const {
  if (isPlane()) return planeCanShow(size, from_map);
  // At a height of h radii, the cylinder stretches the picture along its axis by the factor
  // 1 + h^2. So that this factor stays below kLargestZoom, the whole frame must stay below the
  // height `highest`. If the frame shows the axis itself, a corner or the middle of the frame
  // exceeds this limit, so the test detects this case, too.
  auto points = outline(size, from_map.inverse());
  points.push_back(toMap(from_map.inverse() *
                         Eigen::Vector3d(0.5 * (size.width - 1), 0.5 * (size.height - 1), 1.0)));
  const double highest = camera_(0, 0) * std::sqrt(kLargestZoom - 1.0);
  return std::all_of(points.begin(), points.end(), [&](const Eigen::Vector2d& p) {
    return std::abs(p.y() - camera_(1, 2)) < highest;
  });
}

std::vector<Eigen::Vector2d> Surface::outline(const cv::Size& size,
                                              const Eigen::Matrix3d& to_map) const {
  const auto corners = homography::imageCorners(size, {});
  // A straight side of the frame becomes a curve on the cylinder. A polygon with 16 parts for each
  // side deviates from the curve by less than a pixel.
  const int parts = isPlane() ? 1 : 16;
  std::vector<Eigen::Vector2d> points;
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector2d side = corners[(i + 1) % 4] - corners[i];
    for (int k = 0; k < parts; ++k) {
      const Eigen::Vector2d p = corners[i] + (static_cast<double>(k) / parts) * side;
      const Eigen::Vector2d place = toMap(to_map * p.homogeneous());
      points.push_back(points.empty() ? place : near(place, points.back()));
    }
  }
  return points;
}

}  // namespace ktgp_orb::mosaic
