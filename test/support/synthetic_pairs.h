#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <opencv2/core/types.hpp>
#include <random>
#include <vector>

#include "ktgp_orb/metrics.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::test {

using metrics::cornerError;

inline Eigen::Matrix3d translation(double x, double y) {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  h.topRightCorner<2, 1>() << x, y;
  return h;
}

/// K of a camera, px.
inline Eigen::Matrix3d cameraMatrix(double fx, double fy, double cx = 319.5, double cy = 239.5) {
  Eigen::Matrix3d k = translation(cx, cy);
  k(0, 0) = fx;
  k(1, 1) = fy;
  return k;
}

inline Eigen::Vector2d apply(const Eigen::Matrix3d& h, const Eigen::Vector2d& x) {
  return (h * x.homogeneous()).hnormalized();
}

/// How well the order of quality separates inliers from outliers.
enum class Order {
  good,      ///< inliers tend to come first, with an overlap
  random,    ///< independent of the truth
  reversed,  ///< every outlier comes before every inlier
};

/// Point pairs; `inliers` of them follow a known homography.
struct Scene {
  std::size_t pairs = 100;
  std::size_t inliers = 50;
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();
  Order order = Order::good;
  double sigma = 0.5;  ///< px, Gaussian, in the target
  cv::Size size{640, 480};
};

/// Uniform and normal numbers that are the same with every standard library.
class Numbers {
 public:
  explicit Numbers(std::uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53;
  }
  double normal() {  // Box & Muller
    const double r = std::sqrt(-2.0 * std::log(1.0 - uniform(0.0, 1.0)));
    return r * std::cos(2.0 * M_PI * uniform(0.0, 1.0));
  }
  Eigen::Vector2d pointIn(const cv::Size& size) {
    const double x = uniform(0.0, size.width - 1.0);
    return {x, uniform(0.0, size.height - 1.0)};
  }

 private:
  std::mt19937_64 engine_;
};

inline bool isInside(const Eigen::Vector2d& p, const cv::Size& size) {
  return p.x() >= 0.0 && p.y() >= 0.0 && p.x() <= size.width - 1.0 && p.y() <= size.height - 1.0;
}

inline std::vector<Eigen::Vector2d> corners(const cv::Size& size) {
  const double w = size.width - 1.0;
  const double h = size.height - 1.0;
  return {{0.0, 0.0}, {w, 0.0}, {w, h}, {0.0, h}};
}

/// The homography that maps each corner of the image to `place(corner)`, by plain linear equations.
template <typename Place>
Eigen::Matrix3d byCorners(const cv::Size& size, const Place& place) {
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

/// The homography that moves each corner of the image by up to `shift` of its size.
inline Eigen::Matrix3d randomHomography(const cv::Size& size, double shift, Numbers& numbers) {
  return byCorners(size, [&](const Eigen::Vector2d& corner) {
    const double x = size.width * numbers.uniform(-shift, shift);
    return Eigen::Vector2d(corner +
                           Eigen::Vector2d(x, size.height * numbers.uniform(-shift, shift)));
  });
}

/// Errors in units of their covariances, squared: as many as the error has numbers on average, if
/// the covariances are right.
class Normalised {
 public:
  /// `covariance`: of the error in its first entries. Returns e' S^-1 e.
  template <typename Error, typename Covariance>
  double add(const Error& error, const Covariance& covariance) {
    constexpr int kSize = Error::RowsAtCompileTime;
    const Eigen::Matrix<double, kSize, kSize> part =
        covariance.template topLeftCorner<kSize, kSize>();
    squares_.push_back(error.dot(part.inverse() * error));
    return squares_.back();
  }
  std::size_t count() const { return squares_.size(); }
  double mean() const {
    return std::accumulate(squares_.begin(), squares_.end(), 0.0) / static_cast<double>(count());
  }
  double median() const { return metrics::median(squares_); }
  /// Share below the bound.
  double within(double bound) const {
    const auto below = [&](double square) { return square < bound; };
    return static_cast<double>(std::count_if(squares_.begin(), squares_.end(), below)) /
           static_cast<double>(count());
  }

 private:
  std::vector<double> squares_;
};

/// The error of the first eight entries against their covariance, squared. The entries differ by
/// six orders of magnitude, so each is divided by its own deviation.
inline double squaredDeviation(const UncertainHomography& found, const Eigen::Matrix3d& truth) {
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

inline double qualityOf(bool inlier, Order order, Numbers& numbers) {
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

/// Inliers first, then outliers: uniform in both images and independent.
inline PointPairs makePairs(const Scene& scene, Numbers& numbers) {
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
