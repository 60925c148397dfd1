#include "core/homography/solver.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "core/homography/checks.h"
#include "core/homography/score.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using test::Numbers;

const cv::Size kSize(640, 480);

Eigen::Vector2d project(const Eigen::Matrix3d& h, const Eigen::Vector2d& x) {
  return (h * x.homogeneous()).hnormalized();
}

double area(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  return (b - a).x() * (c - a).y() - (b - a).y() * (c - a).x();
}

/// Least over the four triangles, with the sign that tells whether the images agree on it.
bool sameOrientation(const FourPoints& x, const FourPoints& u, double min_area) {
  for (std::size_t skip = 0; skip < 4; ++skip) {
    std::size_t k[3];
    for (std::size_t i = 0, j = 0; i < 4; ++i) {
      if (i != skip) k[j++] = i;
    }
    const double from = area(x[k[0]], x[k[1]], x[k[2]]);
    const double to = area(u[k[0]], u[k[1]], u[k[2]]);
    if (std::abs(from) < min_area || std::abs(to) < min_area || from * to <= 0.0) return false;
  }
  return true;
}

TEST(HomographySolver, MapsTheFourPointsOrSaysThatNoPlaneLooksLikeThat) {
  Numbers numbers(1);
  int solved = 0;
  for (int run = 0; run < 20000; ++run) {
    FourPoints x;
    FourPoints u;
    for (std::size_t i = 0; i < 4; ++i) {
      x[i] = numbers.pointIn(kSize);
      u[i] = numbers.pointIn(kSize);
    }
    Eigen::Matrix3d h;
    const bool found = solveFourPoints(x, u, 9.0, 9.0, h);
    ASSERT_EQ(found, sameOrientation(x, u, 9.0));
    if (!found) continue;
    ++solved;
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_GT((h * x[i].homogeneous()).z(), 0.0);
      EXPECT_LT((project(h, x[i]) - u[i]).norm(), 1e-4);
    }
  }
  EXPECT_GT(solved, 1000);
}

TEST(HomographySolver, RecoversKnownHomographies) {
  Numbers numbers(2);
  for (int run = 0; run < 1000; ++run) {
    const Eigen::Matrix3d truth = test::randomHomography(kSize, 0.2, numbers);
    FourPoints x{Eigen::Vector2d(10, 20), {600, 40}, {620, 470}, {30, 400}};
    FourPoints u;
    for (std::size_t i = 0; i < 4; ++i) u[i] = project(truth, x[i]);
    Eigen::Matrix3d h;
    ASSERT_TRUE(solveFourPoints(x, u, 1.0, 1.0, h));
    EXPECT_LT((h / h(2, 2) - truth).norm(), 1e-8 * truth.norm());
  }
}

TEST(HomographySolver, RefusesFlatAndRepeatedPoints) {
  const FourPoints square{Eigen::Vector2d(0, 0), {100, 0}, {100, 100}, {0, 100}};
  const FourPoints flat{Eigen::Vector2d(0, 0), {50, 0}, {100, 0}, {0, 100}};
  const FourPoints repeated{Eigen::Vector2d(0, 0), {100, 0}, {100, 100}, {100, 100}};
  Eigen::Matrix3d h;
  EXPECT_FALSE(solveFourPoints(flat, square, 1.0, 1.0, h));
  EXPECT_FALSE(solveFourPoints(square, flat, 1.0, 1.0, h));
  EXPECT_FALSE(solveFourPoints(repeated, square, 1.0, 1.0, h));
  EXPECT_FALSE(solveFourPoints(square, repeated, 1.0, 1.0, h));
  EXPECT_TRUE(solveFourPoints(square, square, 1.0, 1.0, h));
}

TEST(HomographyScore, IsTheSumOfTruncatedSquares) {
  Numbers numbers(3);
  for (std::size_t n = 0; n <= 200; ++n) {
    const Eigen::Matrix3d h = test::randomHomography({2, 2}, 0.05, numbers);
    PointArrays<float> points;
    points.resize(n);
    double expected = 0.0;
    std::size_t inliers = 0;
    std::size_t undecided = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const Eigen::Vector2d x(numbers.uniform(0, 1), numbers.uniform(0, 1));
      Eigen::Vector2d u = project(h, x);
      if (i % 3 != 0) u.x() += numbers.uniform(-0.05, 0.05);
      points.set(i, x, u);
      const double error = (project(h, x) - u).squaredNorm();
      expected += std::min(error, 0.02 * 0.02);
      if (error < 0.02 * 0.02) ++inliers;
      if (std::abs(error - 0.02 * 0.02) < 1e-7) ++undecided;  // within single precision
    }
    constexpr float kNever = std::numeric_limits<float>::infinity();
    EXPECT_NEAR(msacCost(points, h, 0.02, kNever), expected, 1e-6) << n;
    std::vector<std::uint8_t> mask;
    EXPECT_NEAR(static_cast<double>(findInliers(points, h, 0.02, mask)),
                static_cast<double>(inliers), static_cast<double>(undecided))
        << n;
    EXPECT_EQ(mask.size(), n);
    if (expected > 0.002) {
      EXPECT_GT(msacCost(points, h, 0.02, 0.001F), 0.001F) << n;
    }
  }
}

TEST(HomographyChecks, SeesTheHorizonAndTheMirror) {
  const auto corners = imageCorners(kSize, {});
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  EXPECT_TRUE(keepsPlaneInView(h, corners));
  h(2, 0) = -1.0 / 700.0;
  EXPECT_TRUE(keepsPlaneInView(h, corners));
  h(2, 0) = -1.0 / 600.0;
  EXPECT_FALSE(keepsPlaneInView(h, corners));
  h = Eigen::Vector3d(-1.0, 1.0, 1.0).asDiagonal();
  EXPECT_FALSE(keepsPlaneInView(h, corners));
}

TEST(HomographyChecks, CornerDeviationIsThatOfAShiftWhenOnlyTheShiftIsUncertain) {
  const auto corners = imageCorners(kSize, {});
  Eigen::Matrix<double, 8, 8> covariance = Eigen::Matrix<double, 8, 8>::Zero();
  covariance(2, 2) = 9.0;
  covariance(5, 5) = 16.0;
  const Eigen::Matrix3d twice = Eigen::Vector3d(2.0, 2.0, 1.0).asDiagonal();
  const CornerDeviation deviation = cornerDeviation(twice, covariance, corners);
  EXPECT_NEAR(deviation.target, 5.0, 1e-12);
  EXPECT_NEAR(deviation.reference, 2.5, 1e-12);
  covariance(2, 2) = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(std::isinf(cornerDeviation(twice, covariance, corners).target));
  EXPECT_TRUE(std::isinf(cornerDeviation(twice, covariance, corners).reference));
}

}  // namespace
}  // namespace ktgp_orb
