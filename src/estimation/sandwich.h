#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "estimation/robust_fit.h"
#include "util/small_matrix.h"

namespace ktgp_orb::estimation {

/// The covariance of a robust fit is a sandwich, bread × meat × bread (Huber 1967, White 1980). The
/// bread is the inverse of the second derivative of the likelihood, the meat the covariance of its
/// gradient, the sum of the pulls J' w e.

/// Infinite if the measurements do not determine the parameters.
Information breadOf(const NormalEquations& sums);
/// The inverse of J' w J alone, also infinite if that is singular.
Information inverseOf(const util::SmallRef& squares);

Information sandwich(const util::SmallRef& bread, const util::SmallRef& meat);

/// Corrects a mean of squares of n values to which `parameters` were fitted: n / (n - p).
double smallSample(double n, double parameters);

/// The mean of t² e², for each of the d residuals, over the mean weight.
double meanSquare(const NormalEquations& sums, const RobustWeights& weights);
/// The meat if all errors are independent and alike: the mean of t² e² times the sum of J'J, which
/// J'wJ over the mean weight stands for.
Information independentMeat(const NormalEquations& sums, const RobustWeights& weights);

/// For finite samples the covariance is K² times as large: measurements that pull the fit get more
/// weight (Huber, Robust Statistics, 1981, section 7.6). K = 1 + p/n var(d(t e)/de) / mean².
double inflationOfWeights(const NormalEquations& sums, const RobustWeights& weights);

/// The meat where the errors of measurements in one cluster may be correlated in any way (Liang &
/// Zeger, Biometrika 1986). Keeps its buffers.
class ClusteredMeat {
 public:
  /// `most`: number of clusters.
  void reset(Eigen::Index parameters, std::size_t most);
  /// `pull`: J' w e of one measurement.
  void add(std::size_t cluster, const util::SmallRef& pull) { pulls_[cluster] += pull; }
  /// A few clusters determine how strongly errors are correlated, but not the shape of the whole
  /// matrix. The result is `independent`, inflated as the clusters tell, by at least 1.
  Information inflated(const Information& independent) const;
  /// The sum over the clusters, with their small-sample factor. It needs many more clusters than
  /// parameters.
  Information meat() const;

 private:
  Eigen::Index parameters_ = 0;
  std::vector<Step> pulls_;
};

}  // namespace ktgp_orb::estimation
