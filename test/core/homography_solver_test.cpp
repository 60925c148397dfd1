#include "core/homography/fit.h"
#include "core/homography/model.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <vector>

#include "core/homography/m_estimator.h"
#include "core/homography/model.h"
#include "core/homography/point_pairs.h"
#include "core/homography/transform.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::homography {
namespace {

using test::Numbers;

const cv::Size kSize(640, 480);

Eigen::Vector2d project(const Eigen::Matrix3d& h, const Eigen::Vector2d& x) {
  return (h * x.homogeneous()).hnormalized();
}

double area(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  return (b - a).x() * (c - a).y() - (b - a).y() * (c - a).x();
}

/// Minimum over the four triangles, with a sign that tells whether the images agree on the
/// orientation.
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

TEST(HomographyRefiner, FindsTheMostLikelyHomographyFromOneNearby) {
  Numbers numbers(4);
  HomographyRefiner refiner;
  for (int run = 0; run < 50; ++run) {
    test::Scene scene{200, 150, test::randomHomography(kSize, 0.15, numbers), test::Order::good,
                      0.1};
    const PointPairs pairs = test::makePairs(scene, numbers);
    Eigen::Matrix3d shift = Eigen::Matrix3d::Identity();
    shift(0, 2) = 1.5;
    UncertainHomography h;
    h.homography = -2.0 * shift * scene.homography;
    EvidenceOptions options;
    ASSERT_TRUE(refiner.refine(pairs.reference, pairs.target, kSize, options, h));
    EXPECT_EQ(h.homography(2, 2), 1.0);
    EXPECT_LT(test::cornerError(h.homography, scene.homography, kSize), 0.15);
    EXPECT_GT(h.covariance(2, 2), 0.0);
  }
}

TEST(HomographyRefiner, AFloorUnderTheScaleKeepsItFromLockingOntoOnePlane) {
  // Two thirds of the points agree with one plane within 0.02 px; the others are 0.3 px off, more
  // towards the bottom. All are equally accurate, and the best homography for the image is in
  // between.
  Numbers numbers(5);
  std::vector<Eigen::Vector2d> reference;
  std::vector<Eigen::Vector2d> target;
  Eigen::Matrix3d plane = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d other = Eigen::Matrix3d::Identity();
  other(0, 2) = 0.3;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector2d x = numbers.pointIn(kSize);
    const Eigen::Vector2d noise(0.02 * numbers.normal(), 0.02 * numbers.normal());
    reference.push_back(x);
    target.push_back(project(i % 3 == 0 ? other : plane, x) + noise);
  }
  HomographyRefiner refiner;
  EvidenceOptions options;
  UncertainHomography h;
  h.homography = plane;
  ASSERT_TRUE(refiner.refine(reference, target, kSize, options, h));
  EXPECT_LT(test::cornerError(h.homography, plane, kSize), 0.04);
  options.min_scale = 1.0;
  ASSERT_TRUE(refiner.refine(reference, target, kSize, options, h));
  Eigen::Matrix3d mean = plane;
  mean(0, 2) = 0.1;  // least squares: a third of 0.3
  EXPECT_LT(test::cornerError(h.homography, mean, kSize), 0.05);
}

TEST(HomographyRefiner, ByCellManyPairsInOnePlaceDoNotDecideAlone) {
  // 300 pairs on a balcony, 2 px off the plane of the facade, and 80 pairs all over the facade.
  Numbers numbers(7);
  double plain = 0.0;
  double by_cell = 0.0;
  constexpr int kRuns = 20;
  for (int run = 0; run < kRuns; ++run) {
    const Eigen::Matrix3d facade = test::randomHomography(kSize, 0.1, numbers);
    std::vector<Eigen::Vector2d> reference;
    std::vector<Eigen::Vector2d> target;
    for (int i = 0; i < 380; ++i) {
      const bool on_balcony = i < 300;
      const Eigen::Vector2d any = numbers.pointIn(kSize);
      reference.push_back(on_balcony ? Eigen::Vector2d(100.0 + 0.1 * any.x(), 80.0 + 0.1 * any.y())
                                     : any);
      const Eigen::Vector2d noise(0.5 * numbers.normal(), 0.5 * numbers.normal());
      const Eigen::Vector2d off =
          on_balcony ? Eigen::Vector2d(2.0, 1.0) : Eigen::Vector2d(0.0, 0.0);
      target.push_back(project(facade, reference.back()) + noise + off);
    }
    HomographyRefiner refiner;
    EvidenceOptions options;
    UncertainHomography h;
    h.homography = facade;
    ASSERT_TRUE(refiner.refine(reference, target, kSize, options, h));
    plain += test::cornerError(h.homography, facade, kSize) / kRuns;
    options.by_cell = true;
    h.homography = facade;
    ASSERT_TRUE(refiner.refine(reference, target, kSize, options, h));
    by_cell += test::cornerError(h.homography, facade, kSize) / kRuns;
  }
  EXPECT_LT(by_cell, 0.6 * plain);
}

TEST(HomographyRefiner, LeavesTheHomographyWhereThePairsDoNotDetermineIt) {
  Numbers numbers(6);
  HomographyRefiner refiner;
  const EvidenceOptions options;
  const Eigen::Matrix3d before = test::randomHomography(kSize, 0.1, numbers);
  UncertainHomography h;
  h.homography = before;
  std::vector<Eigen::Vector2d> reference;
  std::vector<Eigen::Vector2d> target;
  EXPECT_FALSE(refiner.refine(reference, target, kSize, options, h));
  for (int i = 0; i < 4; ++i) {
    reference.push_back(numbers.pointIn(kSize));
    target.push_back(project(before, reference.back()));
  }
  EXPECT_FALSE(refiner.refine(reference, target, kSize, options, h));
  for (int i = 0; i < 50; ++i) {  // far from the optimum
    reference.push_back(numbers.pointIn(kSize));
    target.emplace_back(project(before, reference.back()) + Eigen::Vector2d(40.0, 0.0));
  }
  EXPECT_FALSE(refiner.refine(reference, target, kSize, options, h));
  EXPECT_EQ(h.homography, before);
  target.pop_back();
  EXPECT_THROW(refiner.refine(reference, target, kSize, options, h), std::invalid_argument);
}

// An odd last pair is processed with a padding pair that still has old values.
TEST(MEstimator, ForgetsThePairsOfTheCallBefore) {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  h(2, 0) = -0.5;  // the horizon is at x = 2
  PointArrays<double> points;
  points.resize(8);
  for (std::size_t i = 0; i < 7; ++i) {
    const Eigen::Vector2d x(0.2 * static_cast<double>(i), i % 3 == 0 ? -0.7 : 0.3 * (i % 2));
    points.set(i, x, project(h, x) + Eigen::Vector2d(1e-3, -1e-3));
  }
  points.set(7, {2.0, 0.1}, {0.0, 0.0});
  MEstimator fresh, used;
  used.select(points, std::vector<std::uint8_t>(8, 1), 8);
  const std::vector<std::uint8_t> first{1, 1, 1, 1, 1, 1, 1, 0};
  ASSERT_EQ(fresh.select(points, first, 8), 7u);
  ASSERT_EQ(used.select(points, first, 8), 7u);
  Eigen::Matrix3d expected = h;
  Eigen::Matrix3d found = h;
  ASSERT_TRUE(fresh.step(0.01, expected));
  ASSERT_TRUE(used.step(0.01, found));
  EXPECT_EQ(found, expected);
  EXPECT_NE(found, h);
}

TEST(HomographyChecks, SeesTheHorizonAndTheMirror) {
  const auto corners = imageCorners(kSize, {});
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  EXPECT_TRUE(keepsPlaneInView(h, corners));
  h(2, 0) = -1.0 / 700.0;
  EXPECT_TRUE(keepsPlaneInView(h, corners));
  for (const double x : {639.1, 600.0}) {  // nearly infinite at the border, and infinite in view
    h(2, 0) = -1.0 / x;
    EXPECT_FALSE(keepsPlaneInView(h, corners)) << x;
  }
  h = Eigen::Vector3d(-1.0, 1.0, 1.0).asDiagonal();
  EXPECT_FALSE(keepsPlaneInView(h, corners));
}

TEST(HomographyChecks, ResizingKeepsTheOutlineOfThePixels) {
  const Eigen::Matrix3d h = resizing({640, 480}, {320, 120});
  EXPECT_LT((project(h, {-0.5, -0.5}) - Eigen::Vector2d(-0.5, -0.5)).norm(), 1e-12);
  EXPECT_LT((project(h, {639.5, 479.5}) - Eigen::Vector2d(319.5, 119.5)).norm(), 1e-12);
}

// An error along one entry of a factor gives the product the error of the changed product.
TEST(ChainedHomography, PropagatesTheErrorOfEachEntry) {
  Numbers numbers(8);
  for (int i = 0; i < 16; ++i) {
    UncertainHomography first, second;
    first.homography = test::randomHomography(kSize, 0.2, numbers);
    second.homography = test::randomHomography(kSize, 0.2, numbers);
    UncertainHomography& uncertain = i < 8 ? first : second;
    const int entry = i % 8;
    const double step = 1e-4 * std::abs(uncertain.homography(entry / 3, entry % 3));
    uncertain.covariance(entry, entry) = step * step;
    const UncertainHomography chain = chained(second, first);
    uncertain.homography(entry / 3, entry % 3) += step;
    const Eigen::Matrix3d change = chained(second, first).homography - chain.homography;
    for (int k = 0; k < 8; ++k) {
      EXPECT_NEAR(std::sqrt(chain.covariance(k, k)), std::abs(change(k / 3, k % 3)),
                  0.01 * std::abs(change(k / 3, k % 3)) + 1e-12)
          << i << ' ' << k;
    }
  }
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
}  // namespace ktgp_orb::homography
