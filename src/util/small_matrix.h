#pragma once

#include <Eigen/Core>
#include <optional>

namespace ktgp_orb::util {

/// A matrix of up to 24 rows and columns, without heap memory. With fixed sizes, the compiler
/// instantiates every Eigen operation again for each combination of sizes, which took a minute for
/// one file. Functions that take this type are compiled once.
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 24, 24>;
using SmallRef = Eigen::Ref<const SmallMatrix, 0, Eigen::OuterStride<>>;

SmallMatrix times(const SmallRef& a, const SmallRef& b);
/// The covariance of the product `slope` * v, if `covariance` is the covariance of the vector v.
SmallMatrix propagated(const SmallRef& slope, const SmallRef& covariance);
/// Inverse of a symmetric matrix.
SmallMatrix inverseOf(const SmallRef& matrix);
/// Solves a x = b for each column of b. Empty unless all pivots of the symmetric matrix a exceed
/// `least`.
std::optional<SmallMatrix> solutionOf(const SmallRef& a, const SmallRef& b, double least);
/// A matrix W with W * covariance * W^T = I; empty if `covariance` is not positive definite.
std::optional<SmallMatrix> whiteningOf(const SmallRef& covariance);

struct LeastSquares {
  SmallMatrix solution;  ///< the x that minimises |b - a x|, for each column of b
  /// Residual b - a x in another orthogonal basis, so that |rest| = |b - a x|.
  SmallMatrix rest;
};
/// Solves a x = b by least squares. `a` has more rows than columns.
LeastSquares leastSquares(const SmallRef& a, const SmallRef& b);

}  // namespace ktgp_orb::util
