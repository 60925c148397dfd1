// Small matrices against Eigen's matrices of any size, on random numbers.

#include "core/util/small_matrix.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

namespace ktgp_orb::util {
namespace {

using Eigen::MatrixXd;

constexpr double kRounding = 1e-10;  // relative
constexpr int kSizes[] = {1, 2, 3, 6, 8, 17, 23, 24};

class Random {
 public:
  MatrixXd matrix(int rows, int cols) {
    return MatrixXd::NullaryExpr(rows, cols, [this] { return normal_(random_); });
  }
  /// Symmetric, eigenvalues of at least 1.
  MatrixXd covariance(int size) {
    const MatrixXd factor = matrix(size, size);
    return factor * factor.transpose() + MatrixXd::Identity(size, size);
  }

 private:
  std::mt19937 random_{1};
  std::normal_distribution<double> normal_;
};

double difference(const MatrixXd& found, const MatrixXd& expected) {
  EXPECT_EQ(found.rows(), expected.rows());
  EXPECT_EQ(found.cols(), expected.cols());
  return (found - expected).norm() / (1.0 + expected.norm());
}

TEST(SmallMatrix, ProductsAreThoseOfEigen) {
  Random random;
  for (const int rows : kSizes) {
    for (const int cols : kSizes) {
      const MatrixXd a = random.matrix(rows, cols);
      const MatrixXd b = random.matrix(cols, 5);
      EXPECT_LT(difference(times(a, b), a.lazyProduct(b)), kRounding) << rows << " x " << cols;
      const MatrixXd c = random.covariance(cols);
      EXPECT_LT(difference(propagated(a, c), (a * c).lazyProduct(a.transpose())), kRounding)
          << rows << " x " << cols;
    }
  }
}

TEST(SmallMatrix, TakesPartsOfLargerMatrices) {
  Random random;
  const Eigen::Matrix<double, 23, 23> large = random.matrix(23, 23);
  const SmallMatrix found = times(large.block<6, 8>(3, 2), large.block<8, 6>(11, 17).eval());
  const MatrixXd a = large.block(3, 2, 6, 8);
  const MatrixXd b = large.block(11, 17, 8, 6);
  EXPECT_LT(difference(found, a * b), kRounding);
}

TEST(SmallMatrix, TheInverseIsThatOfEigen) {
  Random random;
  for (const int size : kSizes) {
    const MatrixXd covariance = random.covariance(size);
    EXPECT_LT(difference(inverseOf(covariance), covariance.inverse()), kRounding) << size;
    MatrixXd indefinite = covariance;
    indefinite.diagonal().array() -= 20.0;
    EXPECT_LT(difference(inverseOf(indefinite) * indefinite, MatrixXd::Identity(size, size)), 1e-6)
        << size;
  }
}

TEST(SmallMatrix, WhiteningMakesACovarianceTheIdentity) {
  Random random;
  for (const int size : kSizes) {
    const MatrixXd covariance = random.covariance(size);
    const auto whitening = whiteningOf(covariance);
    ASSERT_TRUE(whitening) << size;
    const MatrixXd w = *whitening;
    EXPECT_LT(difference(w * covariance * w.transpose(), MatrixXd::Identity(size, size)), kRounding)
        << size;
    EXPECT_FALSE(whiteningOf(-covariance)) << size;
  }
  EXPECT_FALSE(whiteningOf(MatrixXd::Zero(3, 3)));
}

TEST(SmallMatrix, LeastSquaresAreThoseOfEigen) {
  Random random;
  for (const int rows : kSizes) {
    for (const int cols : kSizes) {
      if (cols >= rows) continue;
      const MatrixXd a = random.matrix(rows, cols);
      const MatrixXd b = random.matrix(rows, 3);
      const LeastSquares found = leastSquares(a, b);
      const MatrixXd expected = a.jacobiSvd(Eigen::ComputeThinU | Eigen::ComputeThinV).solve(b);
      EXPECT_LT(difference(found.solution, expected), kRounding) << rows << " x " << cols;
      // The rest is b - a x in other axes: the scalar products of its columns are the same.
      const MatrixXd rest = b - a * expected;
      EXPECT_EQ(found.rest.rows(), rows - cols);
      EXPECT_LT(difference(found.rest.transpose() * found.rest, rest.transpose() * rest), kRounding)
          << rows << " x " << cols;
    }
  }
}

TEST(SmallMatrix, TheRestIsTheRightSideLessTheFit) {
  MatrixXd a(3, 1);
  a << 2.0, 0.0, 0.0;
  const MatrixXd b = Eigen::Vector3d(4.0, 3.0, -5.0);
  const LeastSquares found = leastSquares(a, b);
  EXPECT_NEAR(found.solution(0, 0), 2.0, kRounding);
  EXPECT_NEAR(found.rest(0, 0), 3.0, kRounding);  // the axes across `a` stay
  EXPECT_NEAR(found.rest(1, 0), -5.0, kRounding);
}

}  // namespace
}  // namespace ktgp_orb::util
