#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"
#include "util/keypoint_position.h"

namespace ktgp_orb::test {

/// Levels, inliers and RMSE are those of the published homography, whichever stage found it.
inline void expectOneAnswer(const MatchResult& result, const Features& reference,
                            const Features& target, double max_error) {
  std::size_t inliers = 0;
  double squares = 0.0;
  std::vector<int> uses(target.size(), 0);
  const auto errorOf = [&](const Correspondence& c) {
    return reprojectionError(result.answer.homography, util::position(reference, c.reference_index),
                             util::position(target, c.target_index));
  };
  const auto add = [&](const Correspondence& c) {
    ++inliers;
    squares += errorOf(c) * errorOf(c);
    ++uses[static_cast<std::size_t>(c.target_index)];
  };
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktg) continue;
    EXPECT_EQ(c.level == Level::ktgp, errorOf(c) < max_error);
    if (c.level == Level::ktgp) add(c);
  }
  std::int32_t before = -1;
  for (const Correspondence& c : result.guided) {
    EXPECT_EQ(c.level, Level::guided);
    EXPECT_LT(errorOf(c), max_error);
    EXPECT_GT(c.target_index, before);
    before = c.target_index;
    add(c);
  }
  for (const int count : uses) EXPECT_LE(count, 1) << "a target keypoint has one partner";
  EXPECT_EQ(result.inliers, inliers);
  EXPECT_NEAR(result.rmse, std::sqrt(squares / static_cast<double>(inliers)), 1e-9);
}

}  // namespace ktgp_orb::test
