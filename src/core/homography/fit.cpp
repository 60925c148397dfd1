#include "core/homography/fit.h"

#include <algorithm>
#include <utility>

#include "core/homography/checks.h"
#include "core/homography/estimator.h"
#include "core/homography/score.h"

namespace ktgp_orb {

using Matrix8 = HomographyFit::Matrix8;

FitOutcome HomographyFit::fit(const HomographyProblem& problem, double min_scale,
                              Eigen::Matrix3d& homography) {
  // The weights tell good pairs from bad ones better than the threshold does, so the refinement
  // sees the pairs just beyond it as well.
  constexpr double kReach = 2.0;  // thresholds
  constexpr int kMaxRounds = 10;
  const double least = min_scale * problem.target.scale;
  double scale = std::max(problem.limit / kReach, least);
  for (int round = 0; round < kMaxRounds; ++round) {
    const std::size_t near =
        findInliers(problem.scoring, homography, kReach * problem.limit, near_);
    if (near <= HomographyEstimator::kSampleSize) return FitOutcome::unsupported;
    if (round > 0 && near_ == used_) break;
    std::swap(near_, used_);
    refinement_.select(problem.refinement, used_, near);
    if (!refinement_.minimise(least, scale, homography)) return FitOutcome::undetermined;
  }
  return FitOutcome::fitted;
}

/// With all pairs but one on a line, everything hangs on that one. Deviations count in the image
/// where they are smaller: a strong perspective magnifies a corner that it moves far out of sight,
/// and the error of it likewise.
bool HomographyFit::isDetermined(const HomographyProblem& problem,
                                 const Eigen::Matrix3d& homography,
                                 const std::array<Eigen::Vector2d, 4>& corners) const {
  constexpr double kMaxDeviation = 10.0;         // px at the worst corner
  constexpr double kMaxDeviationWithout = 20.0;  // px, with fewer pairs
  constexpr std::size_t kEnough = 100;           // pairs; more would be determined even better
  const auto deviation = [&](const Matrix8& covariance) {
    const CornerDeviation normalised = cornerDeviation(homography, covariance, corners);
    return std::min(normalised.target / problem.target.scale,
                    normalised.reference / problem.reference.scale);
  };
  if (!(deviation(refinement_.covariance()) < kMaxDeviation)) return false;
  const std::size_t all = refinement_.size();
  const std::size_t folds = all <= 8 ? all : 4;
  const auto holds_with = [&](std::size_t count) {
    for (std::size_t fold = 0; fold < folds; ++fold) {
      const Matrix8 without = refinement_.covarianceWithout(homography, count, fold, folds);
      if (!(deviation(without) < kMaxDeviationWithout)) return false;
    }
    return true;
  };
  return holds_with(std::min(all, kEnough)) || (all > kEnough && holds_with(all));
}

/// By the chain rule through T_target^-1 H T_reference and the division by the last entry.
Covariance8 HomographyFit::pixelCovariance(const HomographyProblem& problem,
                                           const Eigen::Matrix3d& homography) const {
  const Eigen::Matrix3d undivided = problem.toPixels(homography);
  const double divisor = undivided(2, 2);
  const Eigen::Matrix3d pixel = undivided / divisor;
  Matrix8 jacobian;
  for (int j = 0; j < 8; ++j) {
    Eigen::Matrix3d unit = Eigen::Matrix3d::Zero();
    unit(j / 3, j % 3) = 1.0;
    const Eigen::Matrix3d column = problem.toPixels(unit);
    for (int i = 0; i < 8; ++i) {
      jacobian(i, j) = (column(i / 3, i % 3) - pixel(i / 3, i % 3) * column(2, 2)) / divisor;
    }
  }
  // With the scale of the errors estimated from f degrees of freedom, H is distributed as Student's
  // t, whose covariance is f / (f - 2) times what it were with the scale known.
  const double freedom = refinement_.freedom();
  const double spread = freedom / std::max(freedom - 2.0, 1.0);
  const Matrix8 covariance = spread * refinement_.covariance();
  return jacobian * covariance * jacobian.transpose();
}

}  // namespace ktgp_orb
