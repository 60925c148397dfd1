#include "ktgp_orb/ratio_filter.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

namespace ktgp_orb {
namespace {

Correspondence pair(int d1, int d2, Level level = Level::knn) {
  return {0, 0, d1, d2, level};
}

TEST(RatioFilter, IsStrictWhereTheRatioEqualsTheThreshold) {
  // 33/50 is 0.66 to the last bit, but 0.66 * 50 > 33 in floating point.
  std::vector<Correspondence> c{pair(33, 50), pair(32, 50), pair(34, 50)};
  EXPECT_EQ(filterByRatio(0.66, c), 1u);
  EXPECT_EQ(c[0].level, Level::knn);
  EXPECT_EQ(c[1].level, Level::kt);
  EXPECT_EQ(c[2].level, Level::knn);
}

TEST(RatioFilter, DropsIdenticalCandidatesAtEveryThreshold) {
  std::vector<Correspondence> c{pair(0, 0)};
  EXPECT_EQ(filterByRatio(1.0, c), 0u);
}

TEST(RatioFilter, KeepsAnExactMatchWithADistinctSecond) {
  std::vector<Correspondence> c{pair(0, 1)};
  EXPECT_EQ(filterByRatio(0.01, c), 1u);
}

TEST(RatioFilter, AgreesWithRationalArithmeticForEveryPairOfDistances) {
  std::vector<Correspondence> c;
  for (int hundredths = 1; hundredths <= 100; ++hundredths) {
    c.clear();
    for (int d2 = 0; d2 <= 256; ++d2) {
      for (int d1 = 0; d1 <= d2; ++d1) c.push_back(pair(d1, d2));
    }
    filterByRatio(hundredths / 100.0, c);
    for (const Correspondence& x : c) {
      const bool expected = 100 * x.distance < hundredths * x.second_distance;
      ASSERT_EQ(x.level == Level::kt, expected)
          << x.distance << '/' << x.second_distance << " at " << hundredths << '%';
    }
  }
}

TEST(RatioFilter, CountsWhatItKeepsForEverySize) {
  for (int n = 0; n <= 200; ++n) {
    std::vector<Correspondence> c;
    std::size_t expected = 0;
    for (int i = 0; i < n; ++i) {
      c.push_back(pair(i % 17, 10));
      if (i % 17 < 5) ++expected;
    }
    EXPECT_EQ(filterByRatio(0.5, c), expected);
    EXPECT_EQ(countAtLeast(c, Level::kt), expected);
  }
}

TEST(RatioFilter, KeepsOnlyMutualPairsWhereAskedTo) {
  const auto pairs = [] {
    std::vector<Correspondence> c{pair(3, 10), pair(3, 10), pair(9, 10), pair(9, 10)};
    c[0].mutual = c[2].mutual = true;
    return c;
  };
  std::vector<Correspondence> c = pairs();
  EXPECT_EQ(filterByRatio(0.5, c, true), 1u);
  EXPECT_EQ(c[0].level, Level::kt);
  c = pairs();
  EXPECT_EQ(filterByRatio(1.0, c, true), 2u);
  EXPECT_EQ(c[2].level, Level::kt);
  c = pairs();
  EXPECT_EQ(filterByRatio(0.5, c, false), 2u);
}

TEST(RatioFilter, DropsEquallyNearCandidatesAtEveryThresholdMutualOrNot) {
  std::vector<Correspondence> c{pair(10, 10), pair(0, 0), pair(9, 10)};
  for (Correspondence& x : c) x.mutual = true;
  EXPECT_EQ(filterByRatio(1.0, c, true), 1u);
  EXPECT_EQ(c[2].level, Level::kt);
}

TEST(RatioFilter, RefusesAThresholdOutsideItsRange) {
  std::vector<Correspondence> c;
  for (double bad : {0.0, -0.1, 1.01, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THROW(filterByRatio(bad, c), std::invalid_argument);
  }
}

}  // namespace
}  // namespace ktgp_orb
