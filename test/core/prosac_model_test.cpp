// Prosac<> knows no homography: here it finds a line through points, from samples of two.

#include "core/homography/prosac.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/homography/a_contrario.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using test::Numbers;

/// y = slope x + offset
struct Line {
  double slope = 0.0;
  double offset = 0.0;
};

struct LineEstimator {
  using Model = Line;
  static constexpr std::size_t kSampleSize = 2;
  static constexpr double kLimit = 0.02;

  std::vector<Eigen::Vector2d> points;
  int solved = 0;
  int refined_from_wide = 0;

  std::size_t size() const { return points.size(); }

  bool solve(const ProsacSample& sample, Line& line) {
    ++solved;
    EXPECT_EQ(sample.size(), 2u);
    const Eigen::Vector2d a = points[sample[0]];
    const Eigen::Vector2d b = points[sample[1]];
    if (std::abs(a.x() - b.x()) < 1e-6) return false;
    line.slope = (b.y() - a.y()) / (b.x() - a.x());
    line.offset = a.y() - line.slope * a.x();
    return true;
  }

  double error(const Line& line, std::size_t i) const {
    return std::abs(points[i].y() - line.slope * points[i].x() - line.offset);
  }

  float score(const Line& line, float /*give_up*/) const {
    double cost = 0.0;
    for (std::size_t i = 0; i < size(); ++i) {
      const double e = std::min(error(line, i), kLimit);
      cost += e * e;
    }
    return static_cast<float>(cost);
  }

  void score(const Line& line, std::vector<std::uint8_t>& inlier) const {
    inlier.resize(size());
    for (std::size_t i = 0; i < size(); ++i) inlier[i] = error(line, i) < kLimit ? 1 : 0;
  }

  bool refine(double widening, Line& line) {
    if (widening > 1.0) ++refined_from_wide;
    double n = 0.0;
    double x = 0.0;
    double y = 0.0;
    double xx = 0.0;
    double xy = 0.0;
    for (std::size_t i = 0; i < size(); ++i) {
      if (error(line, i) >= widening * kLimit) continue;
      const Eigen::Vector2d& p = points[i];
      n += 1.0;
      x += p.x();
      y += p.y();
      xx += p.x() * p.x();
      xy += p.x() * p.y();
    }
    const double determinant = n * xx - x * x;
    if (n <= 2.0 || determinant < 1e-9) return false;
    line.slope = (n * xy - x * y) / determinant;
    line.offset = (y - line.slope * x) / n;
    return true;
  }
};

/// Points of the unit square, of which one in `one_in` lies on the line y = 0.5 x + 0.1 with noise.
LineEstimator makePoints(std::size_t count, std::size_t one_in, Numbers& numbers) {
  LineEstimator estimator;
  for (std::size_t i = 1; i <= count; ++i) {
    const double x = numbers.uniform(0.0, 1.0);
    const double y =
        i % one_in != 0 ? numbers.uniform(0.0, 1.0) : 0.5 * x + 0.1 + 0.005 * numbers.normal();
    estimator.points.emplace_back(x, y);
  }
  return estimator;
}

TEST(Prosac, FindsALineFromSamplesOfTwo) {
  Numbers numbers(1);
  Prosac<LineEstimator> prosac;
  for (int run = 0; run < 100; ++run) {
    LineEstimator estimator = makePoints(300, 3, numbers);
    ProsacRules rules;
    rules.chance_inlier = 0.04;
    rules.seed = static_cast<std::uint64_t>(run);
    const ProsacRun found = prosac.run(rules, nullptr, estimator);
    ASSERT_TRUE(found.found);
    EXPECT_NEAR(prosac.best().slope, 0.5, 0.02);
    EXPECT_NEAR(prosac.best().offset, 0.1, 0.01);
    EXPECT_FALSE(found.exhausted);
    // One in nine samples is good, so log(0.005)/log(1 - 1/9) = 45 suffice, and 20 from the inliers
    // of each new best; samples of four would
    // need 430.
    EXPECT_LT(found.iterations, 200);
  }
}

TEST(Prosac, CountsEverySampleAndKeepsItsBudget) {
  Numbers numbers(3);
  Prosac<LineEstimator> prosac;
  bool from_support = false;
  for (int budget : {1, 2, 7, 50, 500}) {
    for (int run = 0; run < 20; ++run) {
      LineEstimator estimator = makePoints(300, 20, numbers);
      ProsacRules rules;
      rules.max_iterations = budget;
      rules.confidence = 0.999999;
      const ProsacRun counted = prosac.run(rules, nullptr, estimator);
      EXPECT_EQ(counted.iterations, estimator.solved);
      EXPECT_LE(counted.iterations, budget);
      EXPECT_EQ(counted.local_optimisations, estimator.refined_from_wide);
      if (counted.exhausted) {
        EXPECT_EQ(counted.iterations, budget);
      }
      from_support = from_support || counted.local_optimisations > 1;
    }
  }
  EXPECT_TRUE(from_support);
}

TEST(Prosac, StartsWhereItIsTold) {
  Numbers numbers(2);
  Prosac<LineEstimator> prosac;
  LineEstimator estimator = makePoints(1000, 10, numbers);
  ProsacRules rules;
  rules.max_iterations = 1;
  const Line truth{0.5, 0.1};
  prosac.run(rules, &truth, estimator);
  EXPECT_NEAR(prosac.best().slope, 0.5, 0.02);
  prosac.run(rules, nullptr, estimator);  // and remembers nothing of it
  EXPECT_GT(std::abs(prosac.best().slope - 0.5) + std::abs(prosac.best().offset - 0.1), 0.05);
}

/// log10 of the binomial coefficient.
double logChoose(double n, double k) {
  return (std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0)) / std::log(10.0);
}

TEST(FalseAlarms, IsTheNumberOfSetsAndSamplesTimesTheirProbability) {
  for (std::size_t m : {1, 2, 4, 7}) {
    for (std::size_t n : {10, 50, 1000}) {
      FalseAlarms false_alarms(m, n);
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

}  // namespace
}  // namespace ktgp_orb
