#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "estimation/robust_fit.h"
#include "util/small_matrix.h"

namespace ktgp_orb::estimation {

/// The covariance of a robust fit is a sandwich, bread × meat × bread (Huber 1967, White 1980). The
/// bread is the inverse of the second derivative of the likelihood. The meat is the covariance of
/// the gradient of the likelihood; this gradient is the sum of the pulls J' w e of all
/// measurements.

/// The bread of a fit. All entries are infinite if the measurements do not determine the
/// parameters.
Information breadOf(const NormalEquations& sums);
/// The inverse of `squares`, which is a sum of J' w J. All entries are infinite if `squares` is
/// singular.
Information inverseOf(const util::SmallRef& squares);

Information sandwich(const util::SmallRef& bread, const util::SmallRef& meat);

/// Factor n / (n - p) that corrects the mean square of n residuals after a fit of p `parameters`.
double smallSample(double n, double parameters);

/// Mean of t² e² per residual, divided by the mean weight and multiplied by the small-sample
/// factor.
double meanSquare(const NormalEquations& sums, const RobustWeights& weights);
/// The meat if all errors are independent and have the same variance: the mean of t² e² times the
/// sum of J'J. The sum of J'J is estimated by J'wJ over the mean weight.
Information independentMeat(const NormalEquations& sums, const RobustWeights& weights);

/// The factor K² that corrects the covariance for finite samples. The covariance is too small
/// without it, because measurements that pull the fit towards themselves get more weight (Huber,
/// Robust Statistics, 1981, section 7.6). K = 1 + p/n var(d(t e)/de) / mean(d(t e)/de)².
double inflationOfWeights(const NormalEquations& sums, const RobustWeights& weights);

/// The meat if the errors of measurements in one cluster may be correlated in any way (Liang &
/// Zeger, Biometrika 1986). Keeps its buffers.
class ClusteredMeat {
 public:
  /// `most`: number of clusters; they are numbered from 0.
  void reset(Eigen::Index parameters, std::size_t most);
  /// `pull`: J' w e of one measurement.
  void add(std::size_t cluster, const util::SmallRef& pull) { pulls_[cluster] += pull; }
  /// Returns `independent` times a factor: the mean ratio of meat() to `independent`, but at least
  /// 1. A few clusters are enough to estimate this factor, but not the whole matrix meat().
  Information inflated(const Information& independent) const;
  /// The meat estimated from the clusters alone, with the small-sample factor for the number of
  /// clusters. This number must be much larger than the number of parameters.
  Information meat() const;

 private:
  Eigen::Index parameters_ = 0;
  std::vector<Step> pulls_;
};

}  // namespace ktgp_orb::estimation
