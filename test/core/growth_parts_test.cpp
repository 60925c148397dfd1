// Compares the parts of the growth with plain programs that do the same.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "core/growth/local_matcher.h"
#include "core/growth/map_fit.h"
#include "core/growth/verdict.h"
#include "core/growth/votes.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::growth {
namespace {

using test::Numbers;

const cv::Size kSize(640, 480);

LocalFrame frameAt(const Eigen::Vector2d& p, double angle, double size) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(std::cos(angle)),
          static_cast<float>(std::sin(angle)), static_cast<float>(std::log(size))};
}

/// Two keypoints that may show the same point.
struct FramePair {
  LocalFrame from, to;
};

double angleOf(const LocalFrame& frame) {
  return std::atan2(frame.dy, frame.dx);
}

/// By the definition in votes.h, in double precision; without the limit of one vote per 8x8 px.
bool votesFor(const FramePair& voter, const FramePair& pair) {
  const Eigen::Vector2d d(voter.from.x - pair.from.x, voter.from.y - pair.from.y);
  const double turn = angleOf(pair.to) - angleOf(pair.from);
  const double scale = std::exp(pair.to.log_size - pair.from.log_size);
  const double other_turn = angleOf(voter.to) - angleOf(voter.from);
  const double other_scale = std::exp(voter.to.log_size - voter.from.log_size);
  const Eigen::Vector2d where = Eigen::Vector2d(pair.to.x, pair.to.y) +
                                scale * (Eigen::Rotation2Dd(turn).toRotationMatrix() * d);
  return d.norm() <= 120.0 && std::abs(std::remainder(turn - other_turn, 2.0 * M_PI)) <= 0.5 &&
         std::abs(std::log(scale / other_scale)) <= std::log(1.6) &&
         (where - Eigen::Vector2d(voter.to.x, voter.to.y)).norm() <= 4.0 + 0.45 * scale * d.norm();
}

void count(const std::vector<FramePair>& pairs, Votes& votes) {
  votes.clear();
  for (const FramePair& pair : pairs) votes.add(pair.from, pair.to);
  votes.count(kSize, kSize);
}

TEST(GrowthVotes, VotersAreThoseOfTheDefinition) {
  Numbers numbers(1);
  std::vector<FramePair> pairs;
  for (int i = 0; i < 400; ++i) {
    const Eigen::Vector2d p = numbers.pointIn(kSize);
    const double angle = numbers.uniform(0.0, 2.0 * M_PI);
    const Eigen::Vector2d off(numbers.uniform(-30.0, 30.0), numbers.uniform(-30.0, 30.0));
    pairs.push_back(
        {frameAt(p, angle, 31.0), frameAt(0.8 * p + off, angle + numbers.uniform(-0.6, 0.6),
                                          31.0 * 0.8 * std::exp(numbers.uniform(-0.6, 0.6)))});
  }
  Votes votes;
  count(pairs, votes);
  std::size_t all = 0;
  std::vector<std::int32_t> voters;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    std::set<std::int32_t> expected;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      if (k != i && votesFor(pairs[k], pairs[i])) expected.insert(static_cast<std::int32_t>(k));
    }
    votes.voters(static_cast<std::int32_t>(i), voters);
    EXPECT_EQ(std::set<std::int32_t>(voters.begin(), voters.end()), expected) << i;
    // Once per cell of either image.
    EXPECT_LE(votes.votes()[i], static_cast<std::int32_t>(expected.size()));
    all += expected.size();
  }
  EXPECT_GT(all, 400U);
}

TEST(GrowthVotes, AClusterHasOneVote) {
  const FramePair seed{frameAt({100, 100}, 0, 31), frameAt({200, 200}, 0, 31)};
  const auto near = [](double x) {
    return FramePair{frameAt({x, 140}, 0, 31), frameAt({x + 100, 240}, 0, 31)};
  };
  Votes votes;
  count({seed, near(120.5), near(121.5), near(122.5)}, votes);
  EXPECT_EQ(votes.votes()[0], 1);
  count({seed, near(120.5), near(150.5), near(170.5)}, votes);
  EXPECT_EQ(votes.votes()[0], 3);
}

TEST(GrowthFit, NearAPriorFewPairsAreEnoughAndManyDecide) {
  const Eigen::Matrix2d truth = (Eigen::Matrix2d() << 1.2, 0.3, -0.2, 0.9).finished();
  const Eigen::Vector2d from(100, 100);
  const Eigen::Vector2d to(50, 60);
  Places near, target;
  EXPECT_TRUE(fitAffineNear(near, target, from, to, truth, 30.0)
                  .topLeftCorner(2, 2)
                  .isApprox(truth, 1e-12));
  Numbers numbers(2);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector2d d(numbers.uniform(-100, 100), numbers.uniform(-100, 100));
    near.push_back(from + d);
    target.push_back(to + truth * d);
  }
  const Eigen::Matrix3d map =
      fitAffineNear(near, target, from, to, Eigen::Matrix2d::Identity(), 30.0);
  EXPECT_LT((map.topLeftCorner<2, 2>() - truth).norm(), 1e-3);
  const Eigen::Vector2d middle = (map * from.homogeneous()).hnormalized();
  EXPECT_LT((middle - to).norm(), 1e-9);
}

/// P(Poisson(mean) >= count), summed up.
double logTail(int count, double mean) {
  double sum = 0.0;
  for (int k = count; k < count + 200; ++k) {
    sum += std::exp(k * std::log(mean) - mean - std::lgamma(k + 1.0));
  }
  return std::log10(sum);
}

TEST(GrowthVerdict, IsABoundOnTheTailOfThePoissonDistribution) {
  for (const double mean : {0.1, 1.0, 5.0}) {
    for (const int count : {6, 10, 20, 40}) {
      const double bound = logChance(count, mean, 1.0);
      EXPECT_GE(bound, logTail(count, mean)) << count << " of " << mean;
      EXPECT_LE(bound, logTail(count, mean) + 2.5) << count << " of " << mean;
    }
  }
}

Grown grownFrom(const Eigen::Vector2d& shift, std::size_t matched) {
  Grown grown;
  grown.map = Eigen::Matrix3d::Identity();
  grown.map.topRightCorner<2, 1>() = shift;
  grown.judgement.matched = matched;
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector2d p(200.0 + 20.0 * (i % 8), 200.0 + 20.0 * (i / 8));
    grown.pairs.add(p, p + shift, 0.0);
  }
  return grown;
}

TEST(GrowthRivals, ContradictWhereTheSameIsSeenElsewhere) {
  const Grown grown = grownFrom({0.0, 0.0}, 40);
  std::vector<std::uint8_t> covered;
  const auto contradict = [&](const Grown& rival) {
    return contradicts(rival, grown, kSize, covered);
  };
  EXPECT_TRUE(contradict(grownFrom({40.0, 0.0}, 40)));
  EXPECT_FALSE(contradict(grownFrom({40.0, 0.0}, 20)));   // much poorer
  EXPECT_TRUE(contradict(grownFrom({40.0, 0.0}, 28)));    // within chance
  EXPECT_FALSE(contradict(grownFrom({2.0, 0.0}, 40)));    // the same
  EXPECT_FALSE(contradict(grownFrom({250.0, 0.0}, 40)));  // another plane
}

}  // namespace
}  // namespace ktgp_orb::growth
