#include "evaluation/overlap.h"

#include <cmath>
#include <vector>

#include "evaluation/rendering.h"

namespace ktgp_orb::evaluation {

std::optional<double> overlapCorrelation(const cv::Mat& reference, const cv::Mat& target,
                                         const Eigen::Matrix3d& homography) {
  constexpr double kLeastShare = 0.01;
  cv::Mat values;
  target.convertTo(values, CV_32F);
  // Chooses the sign of H so that the middle of the reference has a positive third coordinate.
  const Eigen::Vector3d middle(0.5 * (reference.cols - 1), 0.5 * (reference.rows - 1), 1.0);
  const Eigen::Matrix3d h = (homography.row(2).dot(middle) < 0.0 ? -1.0 : 1.0) * homography;
  std::vector<double> ours;
  std::vector<double> theirs;
  for (int y = 0; y < reference.rows; ++y) {
    const auto* row = reference.ptr<std::uint8_t>(y);
    for (int x = 0; x < reference.cols; ++x) {
      const Eigen::Vector3d p = h * Eigen::Vector3d(x, y, 1.0);
      const double u = p.x() / p.z();
      const double v = p.y() / p.z();
      if (!(p.z() > 0.0) || !isInside(target.size(), u, v)) continue;
      ours.push_back(row[x]);
      theirs.push_back(sampleBilinear(values, u, v));
    }
  }
  const auto n = static_cast<double>(ours.size());
  if (n < kLeastShare * static_cast<double>(reference.total())) return std::nullopt;
  Eigen::Map<Eigen::ArrayXd> a(ours.data(), static_cast<Eigen::Index>(ours.size()));
  Eigen::Map<Eigen::ArrayXd> b(theirs.data(), a.size());
  a -= a.mean();
  b -= b.mean();
  constexpr double kLeast = 1e-3;  // grey values squared per pixel; rounding errors are smaller
  if (a.square().sum() < kLeast * n || b.square().sum() < kLeast * n) return std::nullopt;
  return (a * b).sum() / std::sqrt(a.square().sum() * b.square().sum());
}

}  // namespace ktgp_orb::evaluation
