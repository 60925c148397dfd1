#pragma once

#include <Eigen/Core>
#include <optional>

namespace ktgp_orb::util {

/// A matrix of up to 24 rows and columns, without heap memory. We do not use matrices of fixed size
/// here: the compiler would instantiate every Eigen operation for each combination of sizes, which
/// took a minute for one file. A function with this type is compiled only once.
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 24, 24>;
using SmallRef = Eigen::Ref<const SmallMatrix, 0, Eigen::OuterStride<>>;

SmallMatrix times(const SmallRef& a, const SmallRef& b);
/// The covariance of the vector slope * v, where v is a vector with this `covariance`.
SmallMatrix propagated(const SmallRef& slope, const SmallRef& covariance);
/// Inverse of a symmetric matrix.
SmallMatrix inverseOf(const SmallRef& matrix);
/// Moore-Penrose inverse: directions that the matrix maps to 0 stay 0.
SmallMatrix pseudoInverseOf(const SmallRef& matrix);

/// Eigenvalues of a symmetric matrix, in ascending order, and its eigenvectors as columns.
struct Eigenpairs {
  SmallMatrix values;
  SmallMatrix vectors;
};
Eigenpairs eigenpairsOf(const SmallRef& matrix);
/// Solves a x = b for each column of b. `a` must be symmetric. Returns nothing unless all pivots of
/// its decomposition exceed `least`.
std::optional<SmallMatrix> solutionOf(const SmallRef& a, const SmallRef& b, double least);
/// Returns a matrix W with W * covariance * W^T = I, or nothing if `covariance` is not positive
/// definite.
std::optional<SmallMatrix> whiteningOf(const SmallRef& covariance);

struct LeastSquares {
  SmallMatrix solution;  ///< for each column of b, the x with the smallest |b - a x|
  /// The residual b - a x in a rotated coordinate system: the lengths are the same, |rest| = |b - a
  /// x|.
  SmallMatrix rest;
};
/// Solves a x = b by least squares. `a` must not have fewer rows than columns.
LeastSquares leastSquares(const SmallRef& a, const SmallRef& b);

}  // namespace ktgp_orb::util
