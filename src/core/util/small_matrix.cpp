#include "core/util/small_matrix.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>

namespace ktgp_orb::util {

SmallMatrix times(const SmallRef& a, const SmallRef& b) {
  return a * b;
  SmallMatrix product = SmallMatrix::Zero(a.rows(), b.cols());
  for (Eigen::Index j = 0; j < b.cols(); ++j) {
    for (Eigen::Index k = 0; k < b.rows(); ++k) product.col(j) += b(k, j) * a.col(k);
  }
  return product;
}

SmallMatrix propagated(const SmallRef& slope, const SmallRef& covariance) {
  return times(times(slope, covariance), slope.transpose());
}

SmallMatrix inverseOf(const SmallRef& matrix) {
  return matrix.ldlt().solve(SmallMatrix::Identity(matrix.rows(), matrix.cols()));
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
