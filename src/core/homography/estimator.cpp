#include "core/homography/estimator.h"

#include "core/homography/score.h"

namespace ktgp_orb {

bool HomographyEstimator::solve(const ProsacSample& sample, Eigen::Matrix3d& homography) const {
  const PointArrays<double>& p = problem.refinement;
  FourPoints from;
  FourPoints to;
  for (std::size_t i = 0; i < kSampleSize; ++i) {
    from[i] = {p.x[sample[i]], p.y[sample[i]]};
    to[i] = {p.u[sample[i]], p.v[sample[i]]};
  }
  return solveFourPoints(from, to, problem.min_reference_area, problem.min_target_area, homography);
}

float HomographyEstimator::score(const Eigen::Matrix3d& homography, float give_up) const {
  return msacCost(problem.scoring, homography, problem.limit, give_up);
}

void HomographyEstimator::score(const Eigen::Matrix3d& homography,
                                std::vector<std::uint8_t>& inlier) const {
  findInliers(problem.scoring, homography, problem.limit, inlier);
}

bool HomographyEstimator::refine(double widening, Eigen::Matrix3d& homography) {
  constexpr std::size_t kEnough = 200;  // pairs, the best by quality; more would not find more
  constexpr double kScales = 3.0;       // of the errors within the limit
  const double limit = widening * problem.limit;
  findInliers(problem.scoring, homography, limit, near_);
  if (refinement_.select(problem.refinement, near_, kEnough) <= kSampleSize) return false;
  return refinement_.step(limit / kScales, homography);
}

}  // namespace ktgp_orb
