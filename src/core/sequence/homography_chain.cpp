#include "core/sequence/homography_chain.h"

#include <cmath>

namespace ktgp_orb::sequence {
namespace {

using Matrix9x8 = Eigen::Matrix<double, 9, 8>;
using Matrix8 = Eigen::Matrix<double, 8, 8>;

Eigen::Matrix3d normalised(const Eigen::Matrix3d& h) {
  return std::abs(h(2, 2)) > 1e-12 * h.norm() ? Eigen::Matrix3d(h / h(2, 2)) : h;
}

/// d(A B)/dA, entries row by row; the last entry of A is fixed.
Matrix9x8 derivativeByFirstFactor(const Eigen::Matrix3d& b) {
  Matrix9x8 j = Matrix9x8::Zero();
  for (Eigen::Index row = 0; row < 3; ++row) {
    const Eigen::Index columns = row < 2 ? 3 : 2;
    j.block(3 * row, 3 * row, 3, columns) = b.transpose().leftCols(columns);
  }
  return j;
}

/// d(A B)/dB, the last entry of B fixed.
Matrix9x8 derivativeBySecondFactor(const Eigen::Matrix3d& a) {
  Matrix9x8 j = Matrix9x8::Zero();
  for (int row = 0; row < 3; ++row) {
    for (int k = 0; k < 3; ++k) {
      for (int column = 0; column < 3; ++column) {
        if (3 * k + column < 8) j(3 * row + column, 3 * k + column) = a(row, k);
      }
    }
  }
  return j;
}

/// Of the first eight entries of C / C(2,2).
Matrix8 normalisedDerivative(const Matrix9x8& derivative, const Eigen::Matrix3d& c) {
  Matrix8 j;
  for (int i = 0; i < 8; ++i) {
    j.row(i) = (derivative.row(i) - c(i / 3, i % 3) / c(2, 2) * derivative.row(8)) / c(2, 2);
  }
  return j;
}

}  // namespace

UncertainHomography chained(const UncertainHomography& second, const UncertainHomography& first) {
  const Eigen::Matrix3d product = second.homography * first.homography;
  const Matrix8 by_second =
      normalisedDerivative(derivativeByFirstFactor(first.homography), product);
  const Matrix8 by_first =
      normalisedDerivative(derivativeBySecondFactor(second.homography), product);
  UncertainHomography result;
  result.homography = normalised(product);
  result.covariance = by_second * second.covariance * by_second.transpose() +
                      by_first * first.covariance * by_first.transpose();
  return result;
}

}  // namespace ktgp_orb::sequence
