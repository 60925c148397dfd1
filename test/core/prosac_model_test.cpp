// The search for a homography, and the number of false alarms of the verdict.

#include "core/homography/verdict.h"
#include "core/prosac/prosac.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/homography/model.h"
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
    ASSERT_TRUE(search.run(rules, nullptr, problem));
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
      search.run(rules, nullptr, problem);
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
    search.run(rules, &*start, problem);
    EXPECT_LT(cornerError(search, pairs, truth), 3.0);
    const bool found = search.run(rules, nullptr, problem);  // and no old state remains
    if (found && cornerError(search, pairs, truth) < 3.0) ++found_alone;
  }
  EXPECT_LT(found_alone, 3);
}

/// Numbers, of which a model is the mean of four; counts the samples.
struct Mean {
  using Model = double;
  static constexpr std::size_t kSample = 4;
  std::vector<double> values;
  int samples = 0;
  int right = 0;  ///< those from the numbers near zero alone

  std::size_t size() const { return values.size(); }
  template <typename Visit>
  void solve(const prosac::ProsacSample& sample, Visit visit) {
    double mean = 0.0;
    int near = 0;
    for (const std::size_t i : sample) {
      mean += values[i] / kSample;
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
  prosac::ProsacSearch<Mean> search;
  ProsacRules rules;
  rules.max_iterations = 5000;
  rules.confidence = 1.0 - 1e-9;
  ASSERT_TRUE(search.run(rules, nullptr, problem));
  EXPECT_NEAR(search.best(), 0.0, 0.1);
  EXPECT_EQ(search.iterations(), problem.samples);
  EXPECT_GE(problem.right, 20) << "one in 300 of all samples";
}

TEST(ProsacSearch, DrawsAtLeastAsManySamplesAsItIsTold) {
  Mean problem;
  problem.values.assign(100, 0.0);
  prosac::ProsacSearch<Mean> search;
  ProsacRules rules;
  for (const int fewest : {0, 40}) {
    problem.samples = 0;
    rules.min_iterations = fewest;
    ASSERT_TRUE(search.run(rules, nullptr, problem));
    EXPECT_EQ(problem.samples, std::max(fewest, 1));
  }
}

TEST(CoveredArea, LeavesOutWhatIsFarFromTheOthers) {
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 100; ++i) points.emplace_back(10.0 * (i % 10), 5.0 * (i / 10));
  EXPECT_NEAR(coveredArea(points), 90.0 * 45.0, 1e-9);
  for (const Eigen::Vector2d& far :
       {Eigen::Vector2d(1e4, 20.0), {-1e4, 20.0}, {40.0, 1e4}, {40.0, -1e4}}) {
    points.push_back(far);
    EXPECT_NEAR(coveredArea(points), 90.0 * 45.0, 1e-9) << far.transpose();
  }
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
