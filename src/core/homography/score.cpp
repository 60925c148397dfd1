#include "core/homography/score.h"

#include <algorithm>

namespace ktgp_orb::homography {
namespace {

using Points = PointArrays<float>;
using Lanes = Points::Lanes;

/// Squared reprojection errors of eight pairs, in units of their noise. Points on or beyond the
/// horizon get a huge one.
Lanes squaredErrors(const Points& points, const Eigen::Matrix3f& h, std::size_t first) {
  constexpr float kHorizon = 1e-6F;
  const Lanes x = Points::load(points.x, first);
  const Lanes y = Points::load(points.y, first);
  const Lanes w = (h(2, 0) * x + h(2, 1) * y + h(2, 2)).max(kHorizon);
  const Lanes du = h(0, 0) * x + h(0, 1) * y + h(0, 2) - Points::load(points.u, first) * w;
  const Lanes dv = h(1, 0) * x + h(1, 1) * y + h(1, 2) - Points::load(points.v, first) * w;
  return (du * du + dv * dv) / (w * w) * Points::load(points.precision, first);
}

}  // namespace

float msacCost(const Points& points, const Eigen::Matrix3d& homography, double limit,
               float give_up) {
  constexpr std::size_t kBlock = 8 * Points::kLanes;  // pairs between two checks of the sum
  const Eigen::Matrix3f h = homography.cast<float>();
  const float limit2 = static_cast<float>(limit * limit);
  const std::size_t padding = points.paddedSize() - points.size;
  float cost = -limit2 * static_cast<float>(padding);
  for (std::size_t start = 0; start < points.paddedSize(); start += kBlock) {
    Lanes sum = Lanes::Zero();
    const std::size_t end = std::min(start + kBlock, points.paddedSize());
    for (std::size_t i = start; i < end; i += Points::kLanes) {
      sum += squaredErrors(points, h, i).min(limit2);
    }
    cost += sum.sum();
    if (cost > give_up) break;
  }
  return cost;
}

std::size_t findInliers(const Points& points, const Eigen::Matrix3d& homography, double limit,
                        std::vector<std::uint8_t>& inlier) {
  const Eigen::Matrix3f h = homography.cast<float>();
  const float limit2 = static_cast<float>(limit * limit);
  inlier.resize(points.size);
  std::size_t count = 0;
  for (std::size_t first = 0; first < points.size; first += Points::kLanes) {
    const Lanes errors = squaredErrors(points, h, first);
    const std::size_t lanes = std::min(Points::kLanes, points.size - first);
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      inlier[first + lane] = errors[static_cast<Eigen::Index>(lane)] < limit2 ? 1 : 0;
      count += inlier[first + lane];
    }
  }
  return count;
}

}  // namespace ktgp_orb::homography
