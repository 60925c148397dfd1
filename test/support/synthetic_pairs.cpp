#include "synthetic_pairs.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace ktgp_orb::test {

std::vector<Eigen::Vector2d> corners(const cv::Size& size) {
  const double w = size.width - 1.0;
  const double h = size.height - 1.0;
  return {{0.0, 0.0}, {w, 0.0}, {w, h}, {0.0, h}};
}

double qualityOf(bool inlier, Order order, Numbers& numbers) {
  switch (order) {
    case Order::good:
      return inlier ? numbers.uniform(0.0, 0.8) : numbers.uniform(0.4, 1.0);
    case Order::reversed:
      return inlier ? numbers.uniform(0.5, 1.0) : numbers.uniform(0.0, 0.5);
    case Order::random:
      break;
  }
  return numbers.uniform(0.0, 1.0);
}

Eigen::Matrix3d translation(double x, double y) {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  h.topRightCorner<2, 1>() << x, y;
  return h;
}

Eigen::Matrix3d cameraMatrix(double fx, double fy, double cx, double cy) {
  Eigen::Matrix3d k = translation(cx, cy);
  k(0, 0) = fx;
  k(1, 1) = fy;
  return k;
}

Eigen::Vector2d apply(const Eigen::Matrix3d& h, const Eigen::Vector2d& x) {
  return (h * x.homogeneous()).hnormalized();
}

double Numbers::uniform(double low, double high) {
  return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53;
}

double Numbers::normal() {  // Box & Muller
  const double r = std::sqrt(-2.0 * std::log(1.0 - uniform(0.0, 1.0)));
  return r * std::cos(2.0 * M_PI * uniform(0.0, 1.0));
}

Eigen::Vector2d Numbers::pointIn(const cv::Size& size) {
  const double x = uniform(0.0, size.width - 1.0);
  return {x, uniform(0.0, size.height - 1.0)};
}

bool isInside(const Eigen::Vector2d& p, const cv::Size& size) {
  return p.x() >= 0.0 && p.y() >= 0.0 && p.x() <= size.width - 1.0 && p.y() <= size.height - 1.0;
}

Eigen::Matrix3d byCorners(const cv::Size& size,
                          const std::function<Eigen::Vector2d(const Eigen::Vector2d&)>& place) {
  Eigen::Matrix<double, 8, 8> a = Eigen::Matrix<double, 8, 8>::Zero();
  Eigen::Matrix<double, 8, 1> b;
  int row = 0;
  for (const Eigen::Vector2d& c : corners(size)) {
    const Eigen::Vector2d p = place(c);
    a.row(row) << c.x(), c.y(), 1, 0, 0, 0, -p.x() * c.x(), -p.x() * c.y();
    a.row(row + 1) << 0, 0, 0, c.x(), c.y(), 1, -p.y() * c.x(), -p.y() * c.y();
    b.segment<2>(row) = p;
    row += 2;
  }
  const Eigen::Matrix<double, 8, 1> h = a.fullPivLu().solve(b);
  Eigen::Matrix3d homography;
  homography << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0;
  return homography;
}

Eigen::Matrix3d randomHomography(const cv::Size& size, double shift, Numbers& numbers) {
  return byCorners(size, [&](const Eigen::Vector2d& corner) {
    const double x = size.width * numbers.uniform(-shift, shift);
    return Eigen::Vector2d(corner +
                           Eigen::Vector2d(x, size.height * numbers.uniform(-shift, shift)));
  });
}

double Normalised::add(const Eigen::Ref<const Eigen::VectorXd>& error,
                       const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  const Eigen::MatrixXd part = covariance.topLeftCorner(error.size(), error.size());
  squares_.push_back(error.dot(part.inverse() * error));
  return squares_.back();
}

double Normalised::mean() const {
  return std::accumulate(squares_.begin(), squares_.end(), 0.0) / static_cast<double>(count());
}

double Normalised::median() const {
  return metrics::median(squares_);
}

double Normalised::within(double bound) const {
  const auto below = [&](double square) { return square < bound; };
  return static_cast<double>(std::count_if(squares_.begin(), squares_.end(), below)) /
         static_cast<double>(count());
}

double squaredDeviation(const UncertainHomography& found, const Eigen::Matrix3d& truth) {
  using Vector8 = Eigen::Matrix<double, 8, 1>;
  const Vector8 scale = found.covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::Matrix<double, 8, 8> correlation =
      scale.asDiagonal() * Eigen::Matrix<double, 8, 8>(found.covariance) * scale.asDiagonal();
  Vector8 u;
  for (int i = 0; i < 8; ++i) {
    u[i] = scale[i] * (found.homography(i / 3, i % 3) - truth(i / 3, i % 3) / truth(2, 2));
  }
  return u.dot(correlation.ldlt().solve(u));
}

PointPairs makePairs(const Scene& scene, Numbers& numbers) {
  PointPairs pairs;
  while (pairs.size() < scene.pairs) {
    const bool inlier = pairs.size() < scene.inliers;
    const Eigen::Vector2d x = numbers.pointIn(scene.size);
    Eigen::Vector2d u = numbers.pointIn(scene.size);
    if (inlier) {
      u = apply(scene.homography, x);
      if (!isInside(u, scene.size)) continue;
      u.x() += scene.sigma * numbers.normal();
      u.y() += scene.sigma * numbers.normal();
    }
    pairs.add(x, u, qualityOf(inlier, scene.order, numbers));
  }
  return pairs;
}

}  // namespace ktgp_orb::test
