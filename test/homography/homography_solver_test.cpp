#include "estimation/false_alarms.h"
#include "homography/fit.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "estimation/prosac.h"
#include "homography/part_in_view.h"
#include "homography/point_pairs.h"
#include "homography/reprojection_fit.h"
#include "homography/smooth_field.h"
#include "homography/verdict.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::homography {
namespace {

using test::apply;
using test::Numbers;

const cv::Size kSize(640, 480);

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

TEST(HomographySolver, MapsTheFourPointsOrRefusesAnImpossibleView) {
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
      EXPECT_LT((apply(h, x[i]) - u[i]).norm(), 1e-4);
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
    for (std::size_t i = 0; i < 4; ++i) u[i] = apply(truth, x[i]);
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
  for (const FourPoints& bad : {flat, repeated}) {
    EXPECT_FALSE(solveFourPoints(bad, square, 1.0, 1.0, h));
    EXPECT_FALSE(solveFourPoints(square, bad, 1.0, 1.0, h));
  }
  EXPECT_TRUE(solveFourPoints(square, square, 1.0, 1.0, h));
}

TEST(HomographyScore, EqualsSumOfTruncatedSquares) {
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
      Eigen::Vector2d u = apply(h, x);
      if (i % 3 != 0) u.x() += numbers.uniform(-0.05, 0.05);
      points.set(i, x, u);
      const double error = (apply(h, x) - u).squaredNorm();
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

TEST(NormalisedPairs, TheLimitIsInPixelsOfTheTarget) {
  Numbers numbers(6);
  const Eigen::Matrix3d larger = Eigen::Vector3d(4.0, 4.0, 1.0).asDiagonal();
  PointPairs pairs;
  std::size_t near = 0;
  for (int i = 0; i < 200; ++i) {
    const double error = numbers.uniform(0.0, 6.0);
    if (error < 3.0) ++near;
    const Eigen::Vector2d point = numbers.pointIn(kSize);
    pairs.reference.push_back(point);
    pairs.target.emplace_back(4.0 * point.x() + error, 4.0 * point.y());
  }
  NormalisedPairs normalised;
  normalised.load(
      pairs.reference, pairs.target, [](std::size_t i) { return i; }, 3.0);
  std::vector<std::uint8_t> mask;
  EXPECT_EQ(findInliers(normalised.scoring, *normalised.fromPixels(larger), normalised.limit, mask),
            near);
}

TEST(HomographyRefiner, FindsTheMostLikelyHomographyFromOneNearby) {
  Numbers numbers(4);
  HomographyRefiner refiner;
  for (int run = 0; run < 50; ++run) {
    test::Scene scene{200, 150, test::randomHomography(kSize, 0.15, numbers), test::Order::good,
                      0.1};
    const PointPairs pairs = test::makePairs(scene, numbers);
    UncertainHomography h;
    h.homography = -2.0 * test::translation(1.5, 0.0) * scene.homography;
    EvidenceOptions options;
    ASSERT_TRUE(refiner.refine(pairs.reference, pairs.target, kSize, options, h));
    EXPECT_EQ(h.homography(2, 2), 1.0);
    EXPECT_LT(test::cornerError(h.homography, scene.homography, kSize), 0.15);
    EXPECT_GT(h.covariance(2, 2), 0.0);
  }
}

TEST(HomographyRefiner, ScaleFloorPreventsLockingOntoOnePlane) {
  // Two thirds of the points agree with one plane within 0.02 px; the others are 0.3 px off, more
  // towards the bottom. All are equally accurate, and the best homography for the image is in
  // between.
  Numbers numbers(5);
  std::vector<Eigen::Vector2d> reference;
  std::vector<Eigen::Vector2d> target;
  const Eigen::Matrix3d plane = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d other = test::translation(0.3, 0.0);
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector2d x = numbers.pointIn(kSize);
    const Eigen::Vector2d noise(0.02 * numbers.normal(), 0.02 * numbers.normal());
    reference.push_back(x);
    target.push_back(apply(i % 3 == 0 ? other : plane, x) + noise);
  }
  HomographyRefiner refiner;
  EvidenceOptions options;
  UncertainHomography h;
  h.homography = plane;
  ASSERT_TRUE(refiner.refine(reference, target, kSize, options, h));
  EXPECT_LT(test::cornerError(h.homography, plane, kSize), 0.04);
  options.min_scale = 1.0;
  ASSERT_TRUE(refiner.refine(reference, target, kSize, options, h));
  const Eigen::Matrix3d mean = test::translation(0.1, 0.0);  // least squares: a third of 0.3
  EXPECT_LT(test::cornerError(h.homography, mean, kSize), 0.05);
}

TEST(HomographyRefiner, ByCellClusteredPairsDoNotDominate) {
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
      target.push_back(apply(facade, reference.back()) + noise + off);
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
    target.push_back(apply(before, reference.back()));
  }
  EXPECT_FALSE(refiner.refine(reference, target, kSize, options, h));
  for (int i = 0; i < 50; ++i) {  // far from the optimum
    reference.push_back(numbers.pointIn(kSize));
    target.emplace_back(apply(before, reference.back()) + Eigen::Vector2d(40.0, 0.0));
  }
  EXPECT_FALSE(refiner.refine(reference, target, kSize, options, h));
  EXPECT_EQ(h.homography, before);
  target.pop_back();
  EXPECT_THROW(refiner.refine(reference, target, kSize, options, h), std::invalid_argument);
}

// An odd last pair is processed with a padding pair that still has old values.
TEST(ReprojectionFit, ForgetsThePairsOfTheCallBefore) {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  h(2, 0) = -0.5;  // the horizon is at x = 2
  PointArrays<double> points;
  points.resize(8);
  for (std::size_t i = 0; i < 7; ++i) {
    const Eigen::Vector2d x(0.2 * static_cast<double>(i), i % 3 == 0 ? -0.7 : 0.3 * (i % 2));
    points.set(i, x, apply(h, x) + Eigen::Vector2d(1e-3, -1e-3));
  }
  points.set(7, {2.0, 0.1}, {0.0, 0.0});
  ReprojectionFit fresh, used;
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

TEST(HomographyChecks, CutsTheImageOffAtTheHorizon) {
  const auto corners = imageCorners(kSize, {});
  EXPECT_EQ(partInView(Eigen::Matrix3d::Identity(), corners).size(), 4U);
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  h(2, 1) = -1.0 / 240.0;  // the horizon is at y = 240, and the origin in front
  for (const double sign : {1.0, -1.0}) {
    const PartOfImage part = partInView(facing(sign * h), corners);
    ASSERT_EQ(part.size(), 4U);
    for (const Eigen::Vector2d& p : part) EXPECT_LT(p.y(), 240.0);
    EXPECT_GT(overlap(sign * h, kSize), 0.3);
  }
  h = test::translation(0.0, 479.0) * Eigen::Vector3d(1.0, -1.0, 1.0).asDiagonal() * h *
      Eigen::Vector3d(1.0, -1.0, 1.0).asDiagonal() * test::translation(0.0, -479.0);
  h /= h(2, 2);  // seen from the other side: the origin is behind
  for (const Eigen::Vector2d& p : partInView(facing(h), corners)) EXPECT_GT(p.y(), 230.0);
}

TEST(HomographyVerdict, TrustsAPlaneThatIsSeenInPartByItsInliersAlone) {
  Numbers numbers(3);
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  h(2, 1) = -1.0 / 300.0;  // all above y = 300 is in front
  HomographyVerdict verdict;
  ProsacResult labelled;
  for (const std::size_t inliers : {6U, 40U}) {
    PointPairs pairs;
    for (std::size_t i = 0; i < 80; ++i) {
      const Eigen::Vector2d x(numbers.uniform(0.0, 640.0), numbers.uniform(0.0, 200.0));
      const Eigen::Vector2d u = apply(h, x);
      pairs.add(x, i < inliers ? u : Eigen::Vector2d(u + Eigen::Vector2d(30.0 + 5.0 * i, 40.0)),
                0.5);
    }
    for (const double sign : {1.0, -1.0}) {
      EXPECT_EQ(verdict.trusts({sign * h}, pairs, kSize, 3.0, labelled), inliers == 40U) << inliers;
    }
    // Behind the horizon, the same pairs support nothing.
    PointPairs behind;
    for (std::size_t i = 0; i < 80; ++i) {
      const Eigen::Vector2d x(numbers.uniform(0.0, 640.0), numbers.uniform(350.0, 480.0));
      behind.add(x, apply(h, x), 0.5);
    }
    EXPECT_FALSE(verdict.trusts({h}, behind, kSize, 3.0, labelled));
  }
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

TEST(ChainedHomography, SharedErrorsMayBeAlikeAndOthersAreIndependent) {
  const auto shift = [](double noise, double shared) {
    UncertainHomography answer;
    answer.homography.setIdentity();
    answer.shared_covariance(2, 2) = shared * shared;
    answer.covariance(2, 2) = noise * noise + shared * shared;
    return answer;
  };
  const UncertainHomography chain = chained(shift(5.0, 3.0), shift(12.0, 4.0));
  EXPECT_NEAR(chain.shared_covariance(2, 2), 7.0 * 7.0, 1e-9);
  EXPECT_NEAR(chain.covariance(2, 2), 13.0 * 13.0 + 7.0 * 7.0, 1e-9);
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

// The covariance describes the error of the homography, also when neighbouring points have similar
// errors.

/// Results over many scenes with known truth.
struct Consistency {
  double median = 0.0;        ///< median of e' S^-1 e at the corners; 1.39 if S is right
  double within = 0.0;        ///< share below 13.8, the 99.9 % bound
  double noise_within = 0.0;  ///< the same with only the noise's part of S
  double deviation = 0.0;     ///< median of plane_deviation, px
};

/// Errors at the points of one scene.
using Errors =
    std::function<std::vector<Eigen::Vector2d>(const std::vector<Eigen::Vector2d>&, Numbers&)>;

Eigen::Matrix2d spreadBy(const Eigen::Matrix<double, 2, 8>& jacobian,
                         const Covariance8& covariance) {
  return jacobian * covariance * jacobian.transpose();
}

/// `by_cell`: also has two thirds of the points in a ninth of the image.
Consistency measure(const Errors& errors, std::size_t points, double min_scale,
                    bool by_cell = false, bool of_patches = false) {
  constexpr int kScenes = 300;
  Numbers numbers(1);
  HomographyRefiner refiner;
  EvidenceOptions options;
  options.min_scale = min_scale;
  options.by_cell = by_cell;
  options.of_patches = of_patches;
  test::Normalised all, of_noise;
  std::vector<double> deviations;
  for (int scene = 0; scene < kScenes; ++scene) {
    const Eigen::Matrix3d truth = test::randomHomography(kSize, 0.1, numbers);
    std::vector<Eigen::Vector2d> reference, target;
    while (reference.size() < points) {
      const Eigen::Vector2d any = numbers.pointIn(kSize);
      reference.push_back(by_cell && reference.size() % 3 != 0 ? any / 3.0 : any);
    }
    const std::vector<Eigen::Vector2d> off = errors(reference, numbers);
    for (std::size_t i = 0; i < points; ++i) target.push_back(apply(truth, reference[i]) + off[i]);
    UncertainHomography found;
    found.homography = truth;
    EXPECT_TRUE(refiner.refine(reference, target, kSize, options, found));
    deviations.push_back(found.plane_deviation);
    for (const Eigen::Vector2d& corner : imageCorners(kSize, {})) {
      const Eigen::Vector2d error = apply(found.homography, corner) - apply(truth, corner);
      const auto jacobian = jacobianByEntries(found.homography, corner);
      all.add(error, spreadBy(jacobian, found.covariance));
      of_noise.add(error, spreadBy(jacobian, found.covariance - found.shared_covariance));
    }
  }
  return {all.median(), all.within(13.8), of_noise.within(13.8), metrics::median(deviations)};
}

Eigen::Vector2d white(double sigma, Numbers& numbers) {
  const double x = sigma * numbers.normal();
  return {x, sigma * numbers.normal()};
}

/// A field of standard deviation about `tau`: a few wide hills at random positions.
Errors hills(double tau, double sigma) {
  return [=](const std::vector<Eigen::Vector2d>& points, Numbers& numbers) {
    constexpr int kHills = 40;
    constexpr double kWidth = 150.0;  // px
    std::vector<Eigen::Vector2d> places, heights;
    for (int i = 0; i < kHills; ++i) {
      places.emplace_back(numbers.uniform(-200.0, 840.0), numbers.uniform(-200.0, 680.0));
      heights.push_back(white(1.0, numbers));
    }
    std::vector<Eigen::Vector2d> errors;
    double squares = 0.0;
    for (const Eigen::Vector2d& p : points) {
      Eigen::Vector2d sum = Eigen::Vector2d::Zero();
      for (int i = 0; i < kHills; ++i) {
        const double d2 = (p - places[static_cast<std::size_t>(i)]).squaredNorm();
        sum += std::exp(-0.5 * d2 / (kWidth * kWidth)) * heights[static_cast<std::size_t>(i)];
      }
      errors.push_back(sum);
      squares += sum.squaredNorm() / 2.0;
    }
    const double scale = tau / std::sqrt(squares / static_cast<double>(points.size()));
    for (Eigen::Vector2d& e : errors) e = scale * e + white(sigma, numbers);
    return errors;
  };
}

/// Outward distortion of a lens: r³ from the middle.
Errors lens(double at_corner, double sigma) {
  return [=](const std::vector<Eigen::Vector2d>& points, Numbers& numbers) {
    const Eigen::Vector2d middle(319.5, 239.5);
    std::vector<Eigen::Vector2d> errors;
    for (const Eigen::Vector2d& p : points) {
      const Eigen::Vector2d out = (p - middle) / middle.norm();
      errors.emplace_back(at_corner * out.squaredNorm() * out + white(sigma, numbers));
    }
    return errors;
  };
}

/// Independent ones; `octaves`: 1.2^o times as large for keypoints of octave o.
Errors noise(double sigma, double octaves = 0.0) {
  return [=](const std::vector<Eigen::Vector2d>& points, Numbers& numbers) {
    std::vector<Eigen::Vector2d> errors(points.size());
    for (Eigen::Vector2d& e : errors) {
      const double octave = octaves > 0.0 ? std::floor(numbers.uniform(0.0, octaves)) : 0.0;
      e = white(sigma * std::pow(1.2, octave), numbers);
    }
    return errors;
  };
}

struct Case {
  const char* name;
  Errors errors;
  std::vector<std::size_t> points;
  double min_scale;
  bool by_cell;
  double lowest, highest;  ///< bounds of the median
  double within;           ///< at least
};

TEST(SmoothField, ErrorsAreCovered) {
  const std::vector<std::size_t> few_and_many{40, 150, 400, 1500};
  const std::vector<Case> cases{
      {"white noise", noise(0.5), few_and_many, 1e-4, false, 0.8, 1.8, 0.99},
      {"that grows with the pyramid level", noise(0.4, 8.0), {300}, 1e-4, false, 0.5, 1.8, 0.99},
      // Unequal weights of the pairs are part of the covariance.
      {"weighed by cell", noise(0.5), few_and_many, 1e-4, true, 0.5, 2.2, 0.98},
      {"hills weighed by cell", hills(0.5, 0.3), {400}, 1e-4, true, 0.2, 2.5, 0.95},
      // A common error counts once, for any number of points.
      {"hills", hills(0.5, 0.05), {100, 1600}, 1.0, false, 0.0, 1e9, 0.9},
      // The error at the corners, where H is compared, is the largest.
      {"lens", lens(2.0, 0.05), {400}, 1.0, false, 0.0, 6.0, 0.9}};
  for (const Case& each : cases) {
    for (const std::size_t points : each.points) {
      SCOPED_TRACE(each.name + (", " + std::to_string(points)));
      const Consistency c = measure(each.errors, points, each.min_scale, each.by_cell);
      EXPECT_GT(c.median, each.lowest);
      EXPECT_LT(c.median, each.highest);
      EXPECT_GT(c.within, each.within);
    }
  }
}

TEST(SmoothField, TheDeviationFromAPlaneIsThatOfTheScene) {
  for (const double sigma : {0.03, 0.3}) {
    const Consistency c = measure(hills(0.5, sigma), 400, 1.0);
    EXPECT_LT(c.median, 2.5) << sigma;
    EXPECT_GT(c.median, 0.2) << sigma;
    EXPECT_GT(c.within, 0.95) << sigma;
    EXPECT_LT(c.noise_within, 0.7) << "as if the errors were independent, " << sigma;
    EXPECT_GT(c.deviation, 0.25) << sigma;
    EXPECT_LT(c.deviation, 1.5) << sigma;
  }
  EXPECT_GT(measure(lens(2.0, 0.05), 400, 1.0).deviation, 0.1);
  EXPECT_LT(measure(noise(0.5), 400, 1e-4).deviation, 0.1);
}

TEST(SmoothField, TheDeviationFromAPlaneIsInPixelsOfTheTarget) {
  Numbers numbers(3);
  std::vector<Eigen::Vector2d> reference, target, enlarged;
  while (reference.size() < 400) reference.push_back(numbers.pointIn(kSize));
  const std::vector<Eigen::Vector2d> off = hills(0.5, 0.1)(reference, numbers);
  constexpr double kLarger = 4.0;
  for (std::size_t i = 0; i < reference.size(); ++i) {
    target.push_back(reference[i] + off[i]);
    enlarged.push_back(kLarger * target.back());
  }
  EvidenceOptions options;
  options.min_scale = 1.0;
  UncertainHomography equal, larger;
  equal.homography.setIdentity();
  larger.homography = Eigen::Vector3d(kLarger, kLarger, 1.0).asDiagonal();
  HomographyRefiner refiner;
  ASSERT_TRUE(refiner.refine(reference, target, kSize, options, equal));
  options.min_scale *= kLarger;
  options.max_error *= kLarger;
  options.rounding *= kLarger;
  ASSERT_TRUE(refiner.refine(reference, enlarged, kSize, options, larger));
  EXPECT_GT(equal.plane_deviation, 0.1);
  EXPECT_NEAR(larger.plane_deviation / equal.plane_deviation, kLarger, 1e-3);
}

TEST(SmoothField, CoversErrorsOfPatches) {
  const Consistency c = measure(noise(0.2), 150, 1e-4, false, true);
  EXPECT_GT(c.median, 0.5);
  EXPECT_LT(c.median, 1.8);
}

/// The error at the corners, squared, of homographies from points that are rounded to whole pixels.
double ofRounded(double zoom) {
  Numbers numbers(3);
  HomographyRefiner refiner;
  EvidenceOptions options;
  options.rounding = 1.0 / std::sqrt(12.0);
  test::Normalised all;
  for (int scene = 0; scene < 300; ++scene) {
    Eigen::Matrix3d truth = Eigen::Vector3d(zoom, zoom, 1.0).asDiagonal();
    truth(0, 2) = numbers.uniform(0.0, 1.0);
    truth(1, 2) = numbers.uniform(0.0, 1.0);
    std::vector<Eigen::Vector2d> reference, target;
    for (int i = 0; i < 200; ++i) {
      reference.push_back(numbers.pointIn(kSize).array().round());
      target.push_back(project(truth, reference.back()).array().round());
    }
    UncertainHomography found;
    found.homography = truth;
    EXPECT_TRUE(refiner.refine(reference, target, kSize, options, found));
    for (const Eigen::Vector2d& corner : imageCorners(kSize, {})) {
      const Eigen::Vector2d error = project(found.homography, corner) - project(truth, corner);
      const auto jacobian = jacobianByEntries(found.homography, corner);
      all.add(error, spreadBy(jacobian, found.covariance));
    }
  }
  return all.median();
}

// Where points move alike they are rounded alike; where they do not, that is noise which the errors
// show.
TEST(SmoothField, CoversRoundingErrorsThatNeighboursShare) {
  for (const double zoom : {1.0005, 1.37}) {
    const double found = ofRounded(zoom);
    EXPECT_GT(found, 0.5) << zoom;
    EXPECT_LT(found, 3.0) << zoom;
  }
}

TEST(SmoothField, OverlappingPatchesAreFewerIndependentOnes) {
  PointArrays<double> pairs;
  pairs.resize(16);
  Numbers numbers(4);
  for (int i = 0; i < 16; ++i) {
    Eigen::Vector2d x(i % 4, i / 4);  // NOLINT(bugprone-integer-division)
    if (i == 15) x = {2.25, 3.0};     // half of its patch is that of pair 14
    pairs.set(static_cast<std::size_t>(i), x, x + white(0.01, numbers));
  }
  const FieldFit fit = SmoothField().fit(pairs, std::vector<double>(16, 1.0), 1.0,
                                         Eigen::Matrix3d::Identity(), {5.0, 0.0, 0.5});
  EXPECT_NEAR(fit.shared_patches, 1.0 + 2.0 * 0.5 / 16.0, 1e-12);
}

TEST(SmoothField, IsZeroForTooFewPairs) {
  PointArrays<double> pairs;
  pairs.resize(8);
  Numbers numbers(2);
  for (std::size_t i = 0; i < 8; ++i) {
    const Eigen::Vector2d x(numbers.uniform(-1.0, 1.0), numbers.uniform(-1.0, 1.0));
    pairs.set(i, x, x + white(0.01, numbers));
  }
  const FieldFit fit = SmoothField().fit(pairs, std::vector<double>(8, 1.0), 1.0,
                                         Eigen::Matrix3d::Identity(), {4.0, 0.0, 0.1});
  EXPECT_EQ(fit.variance, 0.0);
  EXPECT_EQ(fit.noise_share, 1.0);
  EXPECT_TRUE(fit.covariance.isZero());
}

// The search for a homography, and the number of false alarms of the verdict.

using estimation::ProsacRules;

using Search = estimation::ProsacSearch<HomographyProblem>;

/// Pairs in random order of quality; `inliers` of 300 agree with the homography.
NormalisedPairs makePairs(std::size_t inliers, Numbers& numbers, Eigen::Matrix3d& truth) {
  truth = test::randomHomography(kSize, 0.1, numbers);
  const PointPairs pairs =
      test::makePairs({300, inliers, truth, test::Order::random, 0.3}, numbers);
  NormalisedPairs normalised;
  estimation::QualityOrder order;
  order.sort(pairs.quality);
  normalised.load(
      pairs.reference, pairs.target, [&](std::size_t i) { return order[i]; }, 3.0);
  return normalised;
}

double cornerError(const Search& search, const NormalisedPairs& pairs,
                   const Eigen::Matrix3d& truth) {
  return test::cornerError(pairs.toPixels(search.best()), truth, kSize);
}

TEST(ProsacSearch, FindsTheHomographyThatHalfOfThePairsAgreeWith) {
  Numbers numbers(1);
  Search search;
  HomographyProblem problem;
  for (int run = 0; run < 100; ++run) {
    Eigen::Matrix3d truth;
    const NormalisedPairs pairs = makePairs(150, numbers, truth);
    problem.setPairs(pairs);
    ProsacRules rules;
    rules.seed = static_cast<std::uint64_t>(run);
    ASSERT_TRUE(search.run(rules, std::nullopt, problem));
    EXPECT_LT(cornerError(search, pairs, truth), 3.0);
    EXPECT_FALSE(search.exhausted());
    // One in 16 samples is good, so log(0.005) / log(1 - 1/16) = 82 are enough, plus 20 from the
    // inliers of each new best.
    EXPECT_LT(search.iterations(), 400);
  }
}

TEST(ProsacSearch, CountsEverySampleAndKeepsItsBudget) {
  Numbers numbers(3);
  Search search;
  HomographyProblem problem;
  for (int budget : {1, 2, 7, 50, 500}) {
    for (int run = 0; run < 20; ++run) {
      Eigen::Matrix3d truth;
      const NormalisedPairs pairs = makePairs(60, numbers, truth);
      problem.setPairs(pairs);
      ProsacRules rules;
      rules.max_iterations = budget;
      rules.confidence = 0.999999;
      search.run(rules, std::nullopt, problem);
      EXPECT_LE(search.iterations(), budget);
      if (search.exhausted()) {
        EXPECT_EQ(search.iterations(), budget);
      }
    }
  }
}

TEST(ProsacSearch, StartsFromTheGivenModel) {
  Numbers numbers(2);
  Search search;
  HomographyProblem problem;
  ProsacRules rules;
  rules.max_iterations = 1;
  int found_alone = 0;
  for (int run = 0; run < 20; ++run) {
    Eigen::Matrix3d truth;
    const NormalisedPairs pairs = makePairs(30, numbers, truth);
    problem.setPairs(pairs);
    const auto start = pairs.fromPixels(truth);
    ASSERT_TRUE(start);
    search.run(rules, start, problem);
    EXPECT_LT(cornerError(search, pairs, truth), 3.0);
    const bool found = search.run(rules, std::nullopt, problem);  // and no old state remains
    if (found && cornerError(search, pairs, truth) < 3.0) ++found_alone;
  }
  EXPECT_LT(found_alone, 3);
}

/// Numbers, of which a model is the mean of four; counts the samples.
struct Mean {
  using Model = double;
  static std::size_t sampleSize() { return 4; }
  std::vector<double> values;
  int samples = 0;
  int right = 0;  ///< answers from the numbers near zero alone

  std::size_t size() const { return values.size(); }
  template <typename Visit>
  void solve(const estimation::ProsacSample& sample, Visit visit) {
    double mean = 0.0;
    int near = 0;
    for (const std::size_t i : sample) {
      mean += values[i] / 4.0;
      near += std::abs(values[i]) < 1.0;
    }
    ++samples;
    right += near == 4;
    visit(mean);
  }
  float cost(double model, float) const {
    double sum = 0.0;
    for (const double v : values) sum += std::min((v - model) * (v - model), 1.0);
    return static_cast<float>(sum);
  }
  static bool refine(double, double&) { return false; }
  void findInliers(double model, std::vector<std::uint8_t>& inlier) const {
    inlier.clear();
    for (const double v : values) inlier.push_back(std::abs(v - model) < 1.0);
  }
};

TEST(ProsacSearch, AlsoSamplesFromTheInliersAndCountsThat) {
  Numbers numbers(4);
  Mean problem;  // the right numbers come last
  for (int i = 0; i < 75; ++i) problem.values.push_back(1e3 * numbers.normal());
  for (int i = 0; i < 25; ++i) problem.values.push_back(0.1 * numbers.normal());
  estimation::ProsacSearch<Mean> search;
  ProsacRules rules;
  rules.max_iterations = 5000;
  rules.confidence = 1.0 - 1e-9;
  ASSERT_TRUE(search.run(rules, std::nullopt, problem));
  EXPECT_NEAR(search.best(), 0.0, 0.1);
  EXPECT_EQ(search.iterations(), problem.samples);
  EXPECT_GE(problem.right, 20) << "one in 300 of all samples";
}

TEST(ProsacSearch, DrawsAtLeastMinIterations) {
  Mean problem;
  problem.values.assign(100, 0.0);
  estimation::ProsacSearch<Mean> search;
  ProsacRules rules;
  for (const int fewest : {0, 40}) {
    problem.samples = 0;
    rules.min_iterations = fewest;
    ASSERT_TRUE(search.run(rules, std::nullopt, problem));
    EXPECT_EQ(problem.samples, std::max(fewest, 1));
  }
}

TEST(CoveredArea, LeavesOutFarOutliers) {
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 100; ++i) points.emplace_back(10.0 * (i % 10), 5.0 * (i / 10));
  EXPECT_NEAR(estimation::coveredArea(points), 90.0 * 45.0, 1e-9);
  for (const Eigen::Vector2d& far :
       {Eigen::Vector2d(1e4, 20.0), {-1e4, 20.0}, {40.0, 1e4}, {40.0, -1e4}}) {
    points.push_back(far);
    EXPECT_NEAR(estimation::coveredArea(points), 90.0 * 45.0, 1e-9) << far.transpose();
  }
}

/// log10 of the binomial coefficient.
double logChoose(double n, double k) {
  return (std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0)) / std::log(10.0);
}

TEST(FalseAlarms, EqualsTestsTimesProbability) {
  for (std::size_t m : {1, 2, 4, 7}) {
    for (std::size_t n : {10, 50, 1000}) {
      estimation::FalseAlarms false_alarms(m, n);
      const double pairs = static_cast<double>(n);
      const double sample = static_cast<double>(m);
      for (double k = sample + 1.0; k <= std::min(pairs, 40.0); k += 1.0) {
        const double p = 0.001 * k;
        const double expected = std::log10(pairs - sample) + logChoose(pairs, k) +
                                logChoose(k, sample) + (k - sample) * std::log10(p);
        EXPECT_NEAR(false_alarms.next(p), expected, 1e-8 * (1.0 + std::abs(expected)))
            << m << ' ' << n << ' ' << k;
      }
    }
  }
}

/// The formula of the verdict, for points that are all apart, on the inliers in order of their
/// error.
bool chanceExplains(std::vector<double> errors, double area) {
  std::sort(errors.begin(), errors.end());
  const double n = static_cast<double>(errors.size());
  for (double k = 5.0; k <= n; k += 1.0) {
    const double error = errors[static_cast<std::size_t>(k) - 1];
    if (error >= 3.0) break;
    const double p = std::min(M_PI * error * error / area, 1.0);
    const double log_chance = std::log10(std::max(p, 1.0 / area));
    if (std::log10(n - 4.0) + logChoose(n, k) + logChoose(k, 4.0) + (k - 4.0) * log_chance < -4.0) {
      return false;
    }
  }
  return true;
}

TEST(HomographyVerdict, TrustFollowsTheFormulaForAnyOrderOfTheInliers) {
  Numbers numbers(5);
  HomographyVerdict verdict;
  ProsacResult labelled;
  int trusted = 0;
  constexpr int kRuns = 2000;
  for (int run = 0; run < kRuns; ++run) {
    const double apart = numbers.uniform(10.0, 60.0);  // px
    const double exponent =
        numbers.uniform(0.0, 3.0);  // exponent of the errors: many small ones or few
    const int count = 5 + static_cast<int>(numbers.uniform(0.0, 25.0));
    PointPairs pairs;
    std::vector<double> errors;
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector2d point(apart * (i % 5), apart * (i / 5));
      errors.push_back(4.0 * std::pow(numbers.uniform(0.0, 1.0), exponent));
      pairs.reference.push_back(point);
      pairs.target.emplace_back(point.x(), point.y() + errors.back());
      pairs.quality.push_back(0.0);
    }
    const double area = estimation::coveredArea(pairs.target);
    const bool trusts = verdict.trusts({Eigen::Matrix3d::Identity()}, pairs, kSize, 3.0, labelled);
    EXPECT_EQ(trusts, !chanceExplains(errors, area)) << run;
    trusted += trusts ? 1 : 0;
  }
  EXPECT_GT(trusted, kRuns / 5);
  EXPECT_LT(trusted, kRuns * 4 / 5);
}

}  // namespace
}  // namespace ktgp_orb::homography
