// The thread pool; 16-bit grey values as 8-bit ones; small matrices against Eigen's matrices of any
// size, on random numbers.
#include "util/thread_pool.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <atomic>
#include <clocale>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "allocation_counter.h"
#include "util/cells.h"
#include "util/format.h"
#include "util/grey_levels.h"
#include "util/printable.h"
#include "util/small_matrix.h"

namespace ktgp_orb::util {
namespace {

TEST(Cells, OfALongImageAreAsManyAsItNeeds) {
  const Cells cells(cv::Size(40000, 100), 8.0);
  EXPECT_EQ(cells.count(), 5001U * 13U);
  EXPECT_EQ(cells.at(39999.0, 50.0), 6U * 5001U + 4999U);
  EXPECT_EQ(cells.at(-5.0, 1e9), 12U * 5001U);
  EXPECT_EQ(cells.at(std::nan(""), 0.0), 0U);
  const Cells few(Eigen::Vector2d(-4.0, 2.0), {1e6, 3.0}, 2.0, 64);
  EXPECT_EQ(few.count(), 64U * 2U);
  EXPECT_EQ(few.at(1e5, 4.5), 64U + 63U);
}

TEST(Format, NumbersHavePointsInEachLocale) {
  if (std::setlocale(LC_ALL, "de_DE.UTF-8") == nullptr) {
    GTEST_SKIP() << "the locale de_DE.UTF-8 is not installed";
  }
  const std::string text = format("%.2f %s", 1.5, "a");
  const char own = *std::localeconv()->decimal_point;
  std::setlocale(LC_ALL, "C");
  EXPECT_EQ(text, "1.50 a");
  EXPECT_EQ(own, ',') << "the locale of the program is unchanged";
}

TEST(ThreadPool, RunsEveryIterationOnceForAnyNumberOfThreads) {
  for (int threads : {1, 2, 3, 8}) {
    ThreadPool pool(threads);
    EXPECT_EQ(pool.threads(), threads);
    for (int count = 0; count <= 200; ++count) {
      std::vector<std::atomic<int>> calls(static_cast<std::size_t>(count));
      pool.parallelFor(count, [&](int i) { ++calls[static_cast<std::size_t>(i)]; });
      for (const std::atomic<int>& c : calls) ASSERT_EQ(c, 1) << count << " on " << threads;
    }
  }
}

TEST(ThreadPool, FinishesEveryIterationBeforeItReturns) {
  ThreadPool pool(4);
  for (int repetition = 0; repetition < 2000; ++repetition) {
    std::vector<int> values(5, 0);  // plain ints: a worker still writing would be a race
    pool.parallelFor(5, [&](int i) { values[static_cast<std::size_t>(i)] = i + repetition; });
    for (int i = 0; i < 5; ++i) ASSERT_EQ(values[static_cast<std::size_t>(i)], i + repetition);
  }
}

TEST(ThreadPool, UsesItsThreads) {
  ThreadPool pool(2);
  std::atomic<int> arrived{0};
  // Each iteration waits for the other: a single thread would never finish.
  pool.parallelFor(2, [&](int) {
    ++arrived;
    while (arrived < 2) std::this_thread::yield();
  });
  EXPECT_EQ(arrived, 2);
}

TEST(ThreadPool, StaysOnTheCallerWithOneThread) {
  ThreadPool pool(1);
  const auto caller = std::this_thread::get_id();
  pool.parallelFor(10, [&](int) { EXPECT_EQ(std::this_thread::get_id(), caller); });
}

TEST(ThreadPool, RethrowsAndStaysUsable) {
  for (int threads : {1, 2, 3}) {
    ThreadPool pool(threads);
    for (int repetition = 0; repetition < 100; ++repetition) {
      EXPECT_THROW(pool.parallelFor(50,
                                    [](int i) {
                                      if (i % 7 == 3) throw std::runtime_error("no");
                                    }),
                   std::runtime_error);
      std::atomic<int> calls{0};
      pool.parallelFor(20, [&](int) { ++calls; });
      ASSERT_EQ(calls, 20);
    }
  }
}

TEST(ThreadPool, AllocatesNothingOnceBuilt) {
  ThreadPool pool(3);
  std::atomic<int> sum{0};
  const auto add = [&](int i) { sum += i; };
  pool.parallelFor(100, add);
  const test::AllocationCounter allocations;
  for (int repetition = 0; repetition < 100; ++repetition) pool.parallelFor(100, add);
  EXPECT_EQ(allocations.count(), 0u);
  EXPECT_EQ(sum, 101 * 4950);
}

TEST(ThreadPool, CountsItsOwnAllocations) {  // tests the counter
  const test::AllocationCounter allocations;
  const std::vector<int> some(10);
  EXPECT_EQ(allocations.count(), 1u);
  EXPECT_EQ(allocations.bytes(), 10 * sizeof(int));
}

TEST(ThreadPool, ZeroMeansAllOfTheMachine) {
  EXPECT_GE(ThreadPool(0).threads(), 1);
}

TEST(ThreadPool, RefusesANegativeNumberOfThreads) {
  EXPECT_THROW(ThreadPool(-1), std::invalid_argument);
}

/// A ramp over a thermal camera's few hundred values.
cv::Mat ramp() {
  cv::Mat image(100, 100, CV_16UC1);
  for (int i = 0; i < 10000; ++i) {
    image.at<std::uint16_t>(i / 100, i % 100) = static_cast<std::uint16_t>(30000 + i / 20);
  }
  return image;
}

double mean(const cv::Mat& image) {
  return cv::mean(image)[0];
}

/// SECURITY.md: what others wrote comes into logs with at most 600 bytes of it.
TEST(Printable, KeepsTheFirstBytesWithoutControlCharacters) {
  const std::string kept = printable(std::string(5000, 'x'), 600);
  EXPECT_EQ(kept.substr(0, 600), std::string(600, 'x'));
  EXPECT_LT(kept.size(), 700U);
  EXPECT_LT(printable(std::string(5000, 'x')).size(), 300U);
  for (const char c : printable(std::string("a\x1b[31m\n\r\0b\x7f", 11), 600)) {
    EXPECT_GE(c, ' ');
    EXPECT_LT(c, '\x7f');
  }
}

TEST(GreyStretch, HotAndDeadPixelsDoNotDimTheRest) {
  cv::Mat image = ramp();
  const cv::Mat clean = stretchTo8Bit(image);
  image.at<std::uint16_t>(7, 9) = 65535;
  image.at<std::uint16_t>(50, 50) = 0;
  const cv::Mat seen = stretchTo8Bit(image);
  EXPECT_EQ(seen.type(), CV_8UC1);
  EXPECT_EQ(seen.at<uchar>(7, 9), 255);
  EXPECT_EQ(seen.at<uchar>(50, 50), 0);
  double difference = 0.0;
  cv::Mat mask(image.size(), CV_8U, cv::Scalar(255));
  mask.at<uchar>(7, 9) = mask.at<uchar>(50, 50) = 0;
  cv::minMaxLoc(cv::abs(cv::Mat_<short>(clean) - cv::Mat_<short>(seen)), nullptr, &difference,
                nullptr, nullptr, mask);
  EXPECT_LE(difference, 1.0);
  EXPECT_NEAR(mean(seen), 127.5, 1.5) << "the ramp uses all of the range";
}

TEST(GreyStretch, IgnoresATenthOfAPercentAtEachEnd) {
  // Among 10000 pixels `outliers` at 100 and at 300, and 1 % at 220; the others are 200.
  for (const int outliers : {9, 11}) {
    cv::Mat image(100, 100, CV_16UC1, cv::Scalar(200));
    image.row(50).setTo(220);
    image(cv::Rect(0, 0, outliers, 1)).setTo(100);
    image(cv::Rect(0, 99, outliers, 1)).setTo(300);
    const cv::Mat seen = stretchTo8Bit(image);
    EXPECT_NEAR(seen.at<uchar>(20, 0), outliers < 10 ? 0.0 : 127.5, 0.51);
    EXPECT_NEAR(seen.at<uchar>(50, 0), outliers < 10 ? 255.0 : 153.0, 0.51);
    EXPECT_EQ(seen.at<uchar>(0, 0), 0);
    EXPECT_EQ(seen.at<uchar>(99, 0), 255);
  }
}

TEST(GreyStretch, WholeRangeIsConstant) {
  for (int other : {0, 65535}) {
    cv::Mat image(2, 2, CV_16UC1, cv::Scalar(other));
    image.at<std::uint16_t>(0, 0) = 12850;
    const cv::Mat seen = stretchTo8Bit(image, GreyStretch::range);
    EXPECT_EQ(seen.at<uchar>(0, 0), 50);
    EXPECT_EQ(seen.at<uchar>(1, 1), other == 0 ? 0 : 255);
  }
}

TEST(GreyStretch, UniformImageIsDark) {
  for (int value : {0, 7, 65535}) {
    const cv::Mat even(20, 20, CV_16UC1, cv::Scalar(value));
    EXPECT_EQ(cv::countNonZero(stretchTo8Bit(even)), 0) << value;
  }
}

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

TEST(SmallMatrix, ProductsEqualEigen) {
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

TEST(SmallMatrix, LeastSquaresEqualEigen) {
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

TEST(SmallMatrix, LeastSquaresOfASquareMatrixSolvesExactly) {
  Random random;
  const MatrixXd a = random.matrix(8, 8);
  const LeastSquares found = leastSquares(a, MatrixXd::Identity(8, 8));
  EXPECT_LT(difference(a * found.solution, MatrixXd::Identity(8, 8)), kRounding);
  EXPECT_EQ(found.rest.rows(), 0);
}

/// The four conditions of Moore and Penrose.
TEST(SmallMatrix, ThePseudoInverseLeavesOutWhatTheMatrixMapsToZero) {
  Random random;
  for (const int rank : {1, 4, 6}) {
    const MatrixXd root = random.matrix(6, rank);
    const MatrixXd a = root * root.transpose();
    const MatrixXd inverse = pseudoInverseOf(a);
    EXPECT_LT(difference(a * inverse * a, a), 1e-8) << rank;
    EXPECT_LT(difference(inverse * a * inverse, inverse), 1e-8) << rank;
    EXPECT_LT(difference((a * inverse).transpose(), a * inverse), 1e-8) << rank;
    EXPECT_LT(difference((inverse * a).transpose(), inverse * a), 1e-8) << rank;
  }
}

TEST(SmallMatrix, EigenpairsComposeTheMatrix) {
  Random random;
  const MatrixXd root = random.matrix(8, 8);
  const MatrixXd a = root + root.transpose();
  const Eigenpairs found = eigenpairsOf(a);
  const MatrixXd vectors = found.vectors;
  const Eigen::VectorXd values = found.values;
  EXPECT_LT(difference(vectors * values.asDiagonal() * vectors.transpose(), a), 1e-8);
  EXPECT_LT(difference(vectors.transpose() * vectors, MatrixXd::Identity(8, 8)), 1e-8);
  for (int i = 1; i < 8; ++i) EXPECT_LE(values(i - 1), values(i));
}

}  // namespace
}  // namespace ktgp_orb::util
