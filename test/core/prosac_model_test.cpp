// The search for a homography, and the number of false alarms of the verdict.

#include "core/homography/verdict.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/homography/fit.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::homography {
namespace {

using prosac::ProsacRules;
using test::Numbers;

using Search = prosac::ProsacSearch<HomographyProblem>;

const cv::Size kSize(640, 480);

/// Pairs in random order of quality; `inliers` of 300 agree with the homography.
NormalisedPairs makePairs(std::size_t inliers, Numbers& numbers, Eigen::Matrix3d& truth) {
  truth = test::randomHomography(kSize, 0.1, numbers);
  const PointPairs pairs =
      test::makePairs({300, inliers, truth, test::Order::random, 0.3}, numbers);
  NormalisedPairs normalised;
  prosac::QualityOrder order;
  order.sort(pairs.quality);
  const auto by_quality = [&](std::size_t place) { return order[place]; };
  normalised.load(pairs.reference, pairs.target, by_quality, 3.0);
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

TEST(ProsacSearch, StartsWhereItIsTold) {
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
}  // namespace ktgp_orb::homography
