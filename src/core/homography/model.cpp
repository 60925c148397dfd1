#include "core/homography/model.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace ktgp_orb::homography {
namespace {

/// A projective basis: in homogeneous coordinates, x4 = sum of (area_i / whole) x_i for i = 1..3.
struct Basis {
  Eigen::Matrix3d rows;  // row i is orthogonal to the two points other than x_i: x_j × x_k
  Eigen::Vector3d area;  // doubled signed area of the triangle with x_i replaced by x4
  double whole = 0.0;    // doubled signed area of the triangle x1 x2 x3

  explicit Basis(const FourPoints& p) {
    const Eigen::Vector3d x1 = p[0].homogeneous();
    const Eigen::Vector3d x2 = p[1].homogeneous();
    const Eigen::Vector3d x3 = p[2].homogeneous();
    rows.row(0) = x2.cross(x3);
    rows.row(1) = x3.cross(x1);
    rows.row(2) = x1.cross(x2);
    area = rows * p[3].homogeneous();
    whole = rows.row(0).dot(x1);
  }

  bool flat(double min_area) const {
    return std::abs(whole) < min_area || area.cwiseAbs().minCoeff() < min_area;
  }
};

bool sameOrientation(const Basis& a, const Basis& b) {
  return a.whole * b.whole > 0.0 && (a.area.array() * b.area.array() > 0.0).all();
}

using Points = PointArrays<float>;
using Lanes = Points::Lanes;

/// Squared reprojection errors of eight pairs. Points on or beyond the horizon get a huge one.
Lanes squaredErrors(const Points& points, const Eigen::Matrix3f& h, std::size_t first) {
  constexpr float kHorizon = 1e-6F;
  const Lanes x = Points::load(points.x, first);
  const Lanes y = Points::load(points.y, first);
  const Lanes w = (h(2, 0) * x + h(2, 1) * y + h(2, 2)).max(kHorizon);
  const Lanes du = h(0, 0) * x + h(0, 1) * y + h(0, 2) - Points::load(points.u, first) * w;
  const Lanes dv = h(1, 0) * x + h(1, 1) * y + h(1, 2) - Points::load(points.v, first) * w;
  return (du * du + dv * dv) / (w * w);
}

}  // namespace

// With r_i the rows and a_i, b_i the areas of reference and target, and u_i the target points,
// H = sum over i of (b_i / a_i) u_i r_i^T maps x_i to u_i and x4 to sum of b_i u_i = b_whole u4.
bool solveFourPoints(const FourPoints& reference, const FourPoints& target,
                     double min_reference_area, double min_target_area,
                     Eigen::Matrix3d& homography) {
  const Basis from(reference);
  if (from.flat(min_reference_area)) return false;
  const Basis to(target);
  if (to.flat(min_target_area) || !sameOrientation(from, to)) return false;
  const Eigen::Vector3d ratio = to.area.cwiseQuotient(from.area) / to.whole;
  homography.setZero();
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d u = target[static_cast<std::size_t>(i)].homogeneous();
    homography.noalias() += (ratio[i] * u) * from.rows.row(i);
  }
  return true;
}

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
  return points.markNear(
      limit, [&](std::size_t first) { return squaredErrors(points, h, first); }, inlier);
}

bool HomographyProblem::solve(const prosac::ProsacSample& sample,
                              Eigen::Matrix3d& homography) const {
  const PointArrays<double>& p = pairs_->refinement;
  FourPoints from;
  FourPoints to;
  for (std::size_t i = 0; i < kSample; ++i) {
    from[i] = {p.x[sample[i]], p.y[sample[i]]};
    to[i] = {p.u[sample[i]], p.v[sample[i]]};
  }
  return solveFourPoints(from, to, pairs_->min_reference_area, pairs_->min_target_area, homography);
}

bool HomographyProblem::refine(double widening, Eigen::Matrix3d& homography) {
  constexpr std::size_t kEnough = 200;  // best pairs; more would not find more
  constexpr double kScales = 3.0;       // of the errors within the limit
  const double limit = widening * pairs_->limit;
  ktgp_orb::homography::findInliers(pairs_->scoring, homography, limit, near_);
  if (estimator_.select(pairs_->refinement, near_, kEnough) <= kSample) return false;
  return estimator_.step(limit / kScales, homography);
}

}  // namespace ktgp_orb::homography
