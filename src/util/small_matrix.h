#pragma once

#include <Eigen/Core>
#include <optional>

namespace ktgp_orb::util {

/// A matrix of up to 24 rows and columns, without heap memory. Eigen compiles every operation anew
/// for each combination of fixed sizes, which took a minute for one file; functions of this type
/// are compiled once.
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 24, 24>;
using SmallRef = Eigen::Ref<const SmallMatrix, 0, Eigen::OuterStride<>>;

SmallMatrix times(const SmallRef& a, const SmallRef& b);
/// The covariance of `slope` v, if the vector v has the covariance `covariance`.
SmallMatrix propagated(const SmallRef& slope, const SmallRef& covariance);
/// Inverse of a symmetric matrix.
SmallMatrix inverseOf(const SmallRef& matrix);
/// x with a x = b for each column of b; empty unless the pivots of the symmetric a exceed `least`.
std::optional<SmallMatrix> solutionOf(const SmallRef& a, const SmallRef& b, double least);
/// A matrix W with W covariance W' = I; empty if the covariance is not positive definite.
std::optional<SmallMatrix> whiteningOf(const SmallRef& covariance);

struct LeastSquares {
  SmallMatrix solution;  ///< x with the smallest |b - a x|, for each column of b
  SmallMatrix rest;      ///< b - a x in orthogonal axes: |rest| = |b - a x|
};
/// `a` has more rows than columns.
LeastSquares leastSquares(const SmallRef& a, const SmallRef& b);

}  // namespace ktgp_orb::util
