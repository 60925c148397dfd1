#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <opencv2/core/types.hpp>
#include <random>
#include <vector>

#include "ktgp_orb/metrics.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::test {

using metrics::cornerError;

Eigen::Matrix3d translation(double x, double y);

/// K of a camera, px.
Eigen::Matrix3d cameraMatrix(double fx, double fy, double cx = 319.5, double cy = 239.5);

Eigen::Vector2d apply(const Eigen::Matrix3d& h, const Eigen::Vector2d& x);

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
  double uniform(double low, double high);
  double normal();
  Eigen::Vector2d pointIn(const cv::Size& size);

 private:
  std::mt19937_64 engine_;
};

std::vector<Eigen::Vector2d> corners(const cv::Size& size);
bool isInside(const Eigen::Vector2d& p, const cv::Size& size);

/// The homography that maps each corner of the image to `place(corner)`, by plain linear equations.
Eigen::Matrix3d byCorners(const cv::Size& size,
                          const std::function<Eigen::Vector2d(const Eigen::Vector2d&)>& place);

/// The homography that moves each corner of the image by up to `shift` of its size.
Eigen::Matrix3d randomHomography(const cv::Size& size, double shift, Numbers& numbers);

/// Errors in units of their covariances, squared: as many as the error has numbers on average, if
/// the covariances are right.
class Normalised {
 public:
  /// `covariance`: of the error in its first entries. Returns e' S^-1 e.
  double add(const Eigen::Ref<const Eigen::VectorXd>& error,
             const Eigen::Ref<const Eigen::MatrixXd>& covariance);
  std::size_t count() const { return squares_.size(); }
  double mean() const;
  double median() const;
  /// Share below the bound.
  double within(double bound) const;

 private:
  std::vector<double> squares_;
};

/// The error of the first eight entries against their covariance, squared. The entries differ by
/// six orders of magnitude, so each is divided by its own deviation.
double squaredDeviation(const UncertainHomography& found, const Eigen::Matrix3d& truth);

double qualityOf(bool inlier, Order order, Numbers& numbers);

/// Inliers first, then outliers: uniform in both images and independent.
PointPairs makePairs(const Scene& scene, Numbers& numbers);

}  // namespace ktgp_orb::test
