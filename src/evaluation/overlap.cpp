#include "evaluation/overlap.h"

#include <cmath>

#include "evaluation/rendering.h"

namespace ktgp_orb::tools {
namespace {

/// Sums of pairs of values.
class Correlation {
 public:
  void add(double a, double b) {
    ++n_;
    a_ += a;
    b_ += b;
    aa_ += a * a;
    bb_ += b * b;
    ab_ += a * b;
  }

  double count() const { return n_; }

  std::optional<double> value() const {
    const double variance_a = aa_ - a_ * a_ / n_;
    const double variance_b = bb_ - b_ * b_ / n_;
    constexpr double kLeast =
        1e-3;  // grey values squared per pixel; rounding errors of the sums are smaller
    if (variance_a < kLeast * n_ || variance_b < kLeast * n_) return std::nullopt;
    return (ab_ - a_ * b_ / n_) / std::sqrt(variance_a * variance_b);
  }

 private:
  double n_ = 0.0;
  double a_ = 0.0;
  double b_ = 0.0;
  double aa_ = 0.0;
  double bb_ = 0.0;
  double ab_ = 0.0;
};

}  // namespace

std::optional<double> overlapCorrelation(const cv::Mat& reference, const cv::Mat& target,
                                         const Eigen::Matrix3d& homography) {
  constexpr double kLeastShare = 0.01;
  cv::Mat values;
  target.convertTo(values, CV_32F);
  // H is known up to its sign; the middle of the reference has a positive third coordinate.
  const Eigen::Vector3d middle(0.5 * (reference.cols - 1), 0.5 * (reference.rows - 1), 1.0);
  const Eigen::Matrix3d h = (homography.row(2).dot(middle) < 0.0 ? -1.0 : 1.0) * homography;
  Correlation correlation;
  for (int y = 0; y < reference.rows; ++y) {
    const auto* row = reference.ptr<std::uint8_t>(y);
    for (int x = 0; x < reference.cols; ++x) {
      const Eigen::Vector3d p = h * Eigen::Vector3d(x, y, 1.0);
      const double u = p.x() / p.z();
      const double v = p.y() / p.z();
      if (!(p.z() > 0.0) || !isInside(target.size(), u, v)) continue;
      correlation.add(row[x], sampleBilinear(values, u, v));
    }
  }
  if (correlation.count() < kLeastShare * static_cast<double>(reference.total())) {
    return std::nullopt;
  }
  return correlation.value();
}

}  // namespace ktgp_orb::tools
