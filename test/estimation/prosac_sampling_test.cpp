// Compares the growth function and the two stopping rules with plain sums over binomials.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "estimation/prosac.h"

namespace ktgp_orb::estimation {
namespace {

TEST(QualityOrder, SortsStably) {
  QualityOrder order;
  order.sort({0.5, -1.0, 0.0, -0.0, 2.0, -3.0, 0.5});
  const std::size_t expected[] = {5, 1, 2, 3, 0, 6, 4};
  for (std::size_t i = 0; i < 7; ++i) EXPECT_EQ(order[i], expected[i]) << i;
}

TEST(ProsacSampler, ReachesEveryPairWithinTheBudget) {
  ProsacSample sample;
  for (std::size_t m : {1, 2, 4, 7}) {
    for (int budget : {10, 500, 2000}) {
      for (std::size_t n = m; n <= 4000; n = n < 20 ? n + 1 : n * 2) {
        ProsacSampler sampler(m, n, budget, 1);
        std::size_t before = m;
        for (int t = 1; t <= budget; ++t) {
          sampler.draw(n, sample);
          EXPECT_GE(sampler.growthSetSize(), before);
          before = sampler.growthSetSize();
        }
        EXPECT_EQ(before, n) << "samples of " << m << ", budget " << budget;
      }
    }
  }
}

TEST(ProsacSampler, DrawsDifferentPairsWithTheNewestAmongThem) {
  ProsacSample sample;
  for (std::size_t m : {1, 2, 4, 7}) {
    ProsacSampler sampler(m, 500, 2000, 3);
    for (int t = 1; t <= 2000; ++t) {
      sampler.draw(500, sample);
      EXPECT_EQ(std::set<std::size_t>(sample.begin(), sample.end()).size(), m);
      EXPECT_EQ(*std::max_element(sample.begin(), sample.end()), sampler.growthSetSize() - 1);
    }
  }
}

TEST(ProsacSampler, ReachesTheLastPairWhenSamplesWereDrawnElsewhere) {
  ProsacSample sample;
  ProsacSampler sampler(4, 100, 1000, 1);
  sampler.spend(600);
  while (sampler.left() > 0) sampler.draw(100, sample);
  EXPECT_EQ(sampler.drawn(), 400);
  EXPECT_EQ(sampler.growthSetSize(), 100u);
}

TEST(ProsacSampler, GrowsAsTheFormulaSays) {
  const auto choose = [](std::size_t n, std::size_t k) {
    double product = 1.0;
    for (std::size_t i = 0; i < k; ++i) {
      product *= static_cast<double>(n - i) / static_cast<double>(i + 1);
    }
    return product;
  };
  // A quarter of the budget is more than one sample per pair, and less.
  for (const auto& [budget, steady] : {std::pair(1000, 1.0), std::pair(200, 0.5)}) {
    for (std::size_t m : {2, 4, 7}) {
      const ProsacSampler sampler(m, 100, budget, 1);
      const double rest = budget - 1.0 - steady * static_cast<double>(100 - m);
      for (std::size_t n = m; n <= 100; ++n) {
        const double expected =
            1.0 + steady * static_cast<double>(n - m) + rest * choose(n, m) / choose(100, m);
        EXPECT_NEAR(sampler.samplesUntil(n), expected, 1e-9 * expected) << m << ' ' << n;
      }
    }
  }
}

TEST(ProsacSampler, StartsWithTheBestFour) {
  ProsacSample sample;
  ProsacSampler(4, 1000, 2000, 5).draw(1000, sample);
  EXPECT_EQ(std::set<std::size_t>(sample.begin(), sample.end()),
            (std::set<std::size_t>{0, 1, 2, 3}));
}

TEST(ProsacSampler, GrowsNoFurtherThanTheLimitAndThenSamplesFromAllOfIt) {
  ProsacSample sample;
  ProsacSampler sampler(4, 1000, 2000, 7);
  std::set<std::size_t> largest;
  for (int t = 1; t <= 2000; ++t) {
    sampler.draw(30, sample);
    ASSERT_LE(sampler.growthSetSize(), 30u);
    if (t > 200) largest.insert(*std::max_element(sample.begin(), sample.end()));
  }
  EXPECT_GT(largest.size(), 10u);  // the newest pair is not in every sample
}

TEST(ProsacSampler, IsUniformOnceGrown) {
  constexpr std::size_t kPairs = 10;
  ProsacSampler sampler(4, kPairs, 100, 9);
  std::vector<int> count(kPairs, 0);
  ProsacSample sample;
  for (int t = 0; t < 100000; ++t) {
    sampler.draw(kPairs, sample);
    for (std::size_t i : sample) {
      if (t >= 100) ++count[i];
    }
  }
  for (int c : count) EXPECT_NEAR(c, 39960, 700);  // four standard deviations
}

/// P(Binomial(trials, p) >= least), term by term.
double binomialTail(int trials, int least, double p) {
  double sum = 0.0;
  for (int k = least; k <= trials; ++k) {
    sum +=
        std::exp(std::lgamma(trials + 1.0) - std::lgamma(k + 1.0) - std::lgamma(trials - k + 1.0) +
                 k * std::log(p) + (trials - k) * std::log1p(-p));
  }
  return sum;
}

TEST(ProsacStopping, NonRandomnessIsTheBinomialQuantile) {
  for (int m : {1, 2, 4, 7}) {
    for (double beta : {0.01, 0.05, 0.3}) {
      ProsacStopping stopping;
      stopping.reset(static_cast<std::size_t>(m), 1000, beta, 0.995);
      for (int n = m; n <= 1000; n += n < 60 ? 1 : 47) {
        const int extra = static_cast<int>(stopping.minInliers(static_cast<std::size_t>(n))) - m;
        EXPECT_LT(binomialTail(n - m, extra, beta), 0.05) << m << ' ' << n << ' ' << beta;
        EXPECT_GE(binomialTail(n - m, extra - 1, beta), 0.05) << m << ' ' << n << ' ' << beta;
      }
    }
  }
}

TEST(ProsacStopping, MaximalityTakesTheCheapestBeginning) {
  // 30 of the best 40 pairs are inliers, 10 of the other 60.
  std::vector<std::uint8_t> inlier(100, 0);
  for (std::size_t i = 0; i < 100; ++i) inlier[i] = i < 40 ? i % 4 != 3 : i % 6 == 0;
  ProsacStopping stopping;
  stopping.reset(4, 100, 0.01, 0.995);
  EXPECT_TRUE(std::isinf(stopping.samplesNeeded()));
  stopping.update(inlier);
  double expected = std::numeric_limits<double>::infinity();
  std::size_t best = 0;
  int inliers = 0;
  for (int n = 1; n <= 100; ++n) {
    inliers += inlier[static_cast<std::size_t>(n - 1)];
    if (n < 20) continue;
    double good = 1.0;
    for (int i = 0; i < 4; ++i) good *= static_cast<double>(inliers - i) / (n - i);
    const double needed = std::log(0.005) / std::log(1.0 - good);
    if (needed >= expected * (1.0 - 1e-12)) continue;
    expected = needed;
    best = static_cast<std::size_t>(n);
  }
  EXPECT_EQ(stopping.terminationLength(), best);
  EXPECT_NEAR(stopping.samplesNeeded(), expected, 1e-9 * expected);
}

TEST(ProsacStopping, TheWholeOrderIsABeginningToo) {
  ProsacStopping stopping;
  stopping.reset(4, 20, 0.01, 0.995);  // shorter sets are not considered
  stopping.update(std::vector<std::uint8_t>(20, 1));
  EXPECT_EQ(stopping.terminationLength(), 20u);
  EXPECT_EQ(stopping.samplesNeeded(), 1.0);
}

TEST(ProsacStopping, TakesTheSampleSizeIntoAccount) {
  const std::vector<std::uint8_t> half = [] {
    std::vector<std::uint8_t> inlier(1000, 0);
    for (std::size_t i = 1; i < 1000; i += 2) inlier[i] = 1;
    return inlier;
  }();
  double before = 0.0;
  for (std::size_t m : {1, 2, 4, 7}) {
    ProsacStopping stopping;
    stopping.reset(m, 1000, 0.01, 0.995);
    stopping.update(half);
    // A sample from half inliers is good with probability 2^-m, or a little less without repeats.
    const double expected = std::log(0.005) / std::log1p(-std::pow(0.5, static_cast<double>(m)));
    EXPECT_NEAR(stopping.samplesNeeded(), expected, 0.05 * expected) << m;
    EXPECT_GT(stopping.samplesNeeded(), before);
    before = stopping.samplesNeeded();
  }
}

TEST(ProsacStopping, ChanceSupportDoesNotStopIt) {
  std::vector<std::uint8_t> inlier(200, 0);
  for (std::size_t i : {3, 50, 77, 120, 180}) inlier[i] = 1;
  ProsacStopping stopping;
  stopping.reset(4, 200, 0.05, 0.995);
  stopping.update(inlier);
  EXPECT_TRUE(std::isinf(stopping.samplesNeeded()));
  EXPECT_EQ(stopping.terminationLength(), 200u);
}

}  // namespace
}  // namespace ktgp_orb::estimation
