// The growth function and the two stopping rules against plain sums over binomials.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "core/prosac/sampler.h"
#include "core/prosac/stopping.h"

namespace ktgp_orb {
namespace {

TEST(ProsacSampler, ReachesEveryPairWithinTheBudget) {
  for (int budget : {10, 500, 2000}) {
    for (std::size_t n = 4; n <= 4000; n = n < 20 ? n + 1 : n * 2) {
      ProsacSampler sampler(n, budget, 1);
      std::size_t before = 4;
      for (int t = 1; t <= budget; ++t) {
        sampler.draw(n);
        EXPECT_GE(sampler.growthSetSize(), before);
        before = sampler.growthSetSize();
      }
      EXPECT_EQ(before, n) << "budget " << budget;
    }
  }
}

TEST(ProsacSampler, DrawsFourDifferentPairsWithTheNewestAmongThem) {
  ProsacSampler sampler(500, 2000, 3);
  for (int t = 1; t <= 2000; ++t) {
    const ProsacSample sample = sampler.draw(500);
    EXPECT_EQ(std::set<std::size_t>(sample.begin(), sample.end()).size(), 4u);
    EXPECT_EQ(*std::max_element(sample.begin(), sample.end()), sampler.growthSetSize() - 1);
  }
}

TEST(ProsacSampler, StartsWithTheBestFour) {
  const ProsacSample sample = ProsacSampler(1000, 2000, 5).draw(1000);
  EXPECT_EQ(std::set<std::size_t>(sample.begin(), sample.end()),
            (std::set<std::size_t>{0, 1, 2, 3}));
}

TEST(ProsacSampler, GrowsNoFurtherThanTheLimitAndThenSamplesFromAllOfIt) {
  ProsacSampler sampler(1000, 2000, 7);
  std::set<std::size_t> largest;
  for (int t = 1; t <= 2000; ++t) {
    const ProsacSample sample = sampler.draw(30);
    ASSERT_LE(sampler.growthSetSize(), 30u);
    if (t > 200) largest.insert(*std::max_element(sample.begin(), sample.end()));
  }
  EXPECT_GT(largest.size(), 10u);  // not the newest every time
}

TEST(ProsacSampler, IsUniformOnceGrown) {
  constexpr std::size_t kPairs = 10;
  ProsacSampler sampler(kPairs, 100, 9);
  std::vector<int> count(kPairs, 0);
  for (int t = 0; t < 100000; ++t) {
    for (std::size_t i : sampler.draw(kPairs)) {
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
  for (double beta : {0.01, 0.05, 0.3}) {
    ProsacStopping stopping;
    stopping.reset(1000, beta, 0.995);
    for (int n = 4; n <= 1000; n += n < 60 ? 1 : 47) {
      const int extra = static_cast<int>(stopping.minInliers(static_cast<std::size_t>(n))) - 4;
      EXPECT_LT(binomialTail(n - 4, extra, beta), 0.05) << n << ' ' << beta;
      EXPECT_GE(binomialTail(n - 4, extra - 1, beta), 0.05) << n << ' ' << beta;
    }
  }
}

TEST(ProsacStopping, MaximalityTakesTheCheapestBeginning) {
  // 30 of the best 40 pairs are inliers, 10 of the other 60.
  std::vector<std::uint8_t> inlier(100, 0);
  for (std::size_t i = 0; i < 100; ++i) inlier[i] = i < 40 ? i % 4 != 3 : i % 6 == 0;
  ProsacStopping stopping;
  stopping.reset(100, 0.01, 0.995);
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

TEST(ProsacStopping, ChanceSupportDoesNotStopIt) {
  std::vector<std::uint8_t> inlier(200, 0);
  for (std::size_t i : {3, 50, 77, 120, 180}) inlier[i] = 1;
  ProsacStopping stopping;
  stopping.reset(200, 0.05, 0.995);
  stopping.update(inlier);
  EXPECT_TRUE(std::isinf(stopping.samplesNeeded()));
  EXPECT_EQ(stopping.terminationLength(), 200u);
}

}  // namespace
}  // namespace ktgp_orb
