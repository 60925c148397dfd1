#include "util/small_matrix.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>

namespace ktgp_orb::util {

SmallMatrix times(const SmallRef& a, const SmallRef& b) {
  return a * b;
}

SmallMatrix propagated(const SmallRef& slope, const SmallRef& covariance) {
  return times(times(slope, covariance), slope.transpose());
}

SmallMatrix inverseOf(const SmallRef& matrix) {
  return Eigen::LDLT<SmallMatrix>(matrix).solve(
      SmallMatrix::Identity(matrix.rows(), matrix.cols()));
}

SmallMatrix pseudoInverseOf(const SmallRef& matrix) {
  return Eigen::CompleteOrthogonalDecomposition<SmallMatrix>(matrix).pseudoInverse();
}

Eigenpairs eigenpairsOf(const SmallRef& matrix) {
  const Eigen::SelfAdjointEigenSolver<SmallMatrix> solver(matrix);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

std::optional<SmallMatrix> solutionOf(const SmallRef& a, const SmallRef& b, double least) {
  const Eigen::LDLT<SmallMatrix> factor(a);
  if (!(factor.vectorD().minCoeff() > least)) return std::nullopt;
  return SmallMatrix(factor.solve(b));
}

std::optional<SmallMatrix> whiteningOf(const SmallRef& covariance) {
  const Eigen::LLT<SmallMatrix> factor(covariance);
  if (factor.info() != Eigen::Success) return std::nullopt;
  SmallMatrix whitening = SmallMatrix::Identity(covariance.rows(), covariance.cols());
  factor.matrixL().solveInPlace(whitening);
  return whitening;
}

LeastSquares leastSquares(const SmallRef& a, const SmallRef& b) {
  const Eigen::HouseholderQR<SmallMatrix> factor(a);
  SmallMatrix turned = b;
  turned.applyOnTheLeft(factor.householderQ().adjoint());
  LeastSquares result{turned.topRows(a.cols()), turned.bottomRows(a.rows() - a.cols())};
  factor.matrixQR().topRows(a.cols()).triangularView<Eigen::Upper>().solveInPlace(result.solution);
  return result;
}

}  // namespace ktgp_orb::util
