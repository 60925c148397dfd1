#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "estimation/robust_fit.h"
#include "util/small_matrix.h"

namespace ktgp_orb::estimation {

/// The covariance of a robust fit is a sandwich, bread × meat × bread (Huber 1967, White 1980). The
/// bread is the inverse of the second derivative of the likelihood. The meat is the covariance of
/// the gradient of the likelihood; this gradient is the sum over all measurements of their pulls J'
/// w e (residuals e, Jacobian J and weight w, see NormalEquations).

/// Returns the bread of a fit. All entries are infinite if the measurements do not determine the
/// parameters.
Information breadOf(const NormalEquations& sums);
/// The inverse of `squares`, which is a sum of J' w J. All entries are infinite if `squares` is
/// singular.
Information inverseOf(const util::SmallRef& squares);

Information sandwich(const util::SmallRef& bread, const util::SmallRef& meat);

/// The factor n / (n - p) by which the mean square of n residuals must be multiplied if p
/// `parameters` were fitted to them, because the fit makes the residuals smaller than the noise.
double smallSample(double n, double parameters);

/// The mean of t² e² per residual (t: Student weight, e: residuals), divided by the mean weight and
/// multiplied by smallSample().
double meanSquare(const NormalEquations& sums, const RobustWeights& weights);
/// The meat if all errors are independent and have the same variance: the mean of t² e² times the
/// sum of J'J. The sum of J'J is estimated as the sum of J'wJ divided by the mean weight.
Information independentMeat(const NormalEquations& sums, const RobustWeights& weights);

/// The factor K² that corrects the covariance for finite samples. The covariance is too small
/// without it, because measurements that pull the fit towards themselves get more weight (Huber,
/// Robust Statistics, 1981, section 7.6). K = 1 + p/n var(s) / mean(s)², where n is the number of
/// residuals, p the number of parameters, and s = d(t e)/de the derivative of a weighted residual.
double inflationOfWeights(const NormalEquations& sums, const RobustWeights& weights);

/// The meat if the errors of measurements in one cluster may be correlated in any way (Liang &
/// Zeger, Biometrika 1986). Reuses its buffers from call to call.
class ClusteredMeat {
 public:
  /// `most`: number of clusters; the clusters are numbered from 0.
  void reset(Eigen::Index parameters, std::size_t most);
  /// Adds a measurement that belongs to `cluster`. `pull`: J' w e of the measurement (see
  /// NormalEquations).
  void add(std::size_t cluster, const util::SmallRef& pull) { pulls_[cluster] += pull; }
  /// Returns `independent` (see independentMeat) times a factor. The factor is the mean ratio of
  /// meat() to `independent`, but not below 1. A few clusters are enough to estimate this factor,
  /// but not to estimate the whole matrix meat().
  Information inflated(const Information& independent) const;
  /// The meat estimated from the clusters alone, multiplied by smallSample() for the number of
  /// clusters. There must be many more clusters than parameters.
  Information meat() const;

 private:
  Eigen::Index parameters_ = 0;
  std::vector<Step> pulls_;
};

}  // namespace ktgp_orb::estimation
