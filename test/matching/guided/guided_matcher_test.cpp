#include "ktgp_orb/guided_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "instruction_sets.h"
#include "matching/knn/kernel.h"
#include "plain_search.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

/// Some lie outside: bad data is legal. Few bits differ, and ties are frequent.
Features randomFeatures(std::uint32_t seed, int count, const cv::Size& size) {
  return test::randomFeatures(count, seed, size, 10.F, 3);
}

/// The definition, pair by pair.
std::vector<Correspondence> naive(const Features& reference, const Features& target,
                                  const Eigen::Matrix3d& h, const GuidedOptions& options) {
  const auto near = [&](int r, int t) {
    const cv::Point2f& x = reference.keypoints[r].pt;
    const Eigen::Vector3d p = h * Eigen::Vector3d(x.x, x.y, 1.0);
    const cv::Point2f& u = target.keypoints[t].pt;
    return (p.head<2>() / p.z() - Eigen::Vector2d(u.x, u.y)).norm() <= options.radius;
  };
  std::vector<Correspondence> matches;
  for (Correspondence c : test::plainSearch(reference.descriptors, target.descriptors, near)) {
    if (!c.mutual || c.distance > options.max_distance) continue;
    c.second_distance = std::min(c.second_distance, 256);
    c.level = Level::guided;
    c.mutual = false;
    matches.push_back(c);
  }
  return matches;
}

const Eigen::Matrix3d kShifted = test::translation(1.0, 0.0);

GuidedOptions switchedOn() {
  GuidedOptions options;
  options.enabled = true;
  return options;
}

TEST(GuidedMatcher, EqualsTheDefinition) {
  for (const double radius : {1.0, 6.0, 25.0}) {
    for (const int count : {0, 1, 40, 300}) {
      GuidedOptions options = switchedOn();
      options.radius = radius;
      options.max_distance = 28;
      const Features reference = randomFeatures(1, count, {160, 120});
      const Features target = randomFeatures(2, count + 13, {160, 120});
      Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
      h << 0.9, -0.1, 11.0, 0.12, 1.05, -7.0, 2e-4, -1e-4, 1.0;
      const std::vector<Correspondence> expected = naive(reference, target, h, options);
      if (count == 300 && radius > 5.0) {
        EXPECT_GT(expected.size(), 10u);
      }
      test::forEachInstructionSet([&] {
        SCOPED_TRACE(std::string(knn::bestKnnKernel().name) + ", " + std::to_string(radius) + ", " +
                     std::to_string(count));
        std::vector<Correspondence> matches;
        GuidedMatcher(options).match(reference, target, h, matches);
        EXPECT_TRUE(test::same(matches, expected));
      });
    }
  }
}

TEST(GuidedMatcher, SurvivesAHomographyThatSendsEverythingAway) {
  const Features features = randomFeatures(3, 50, {160, 120});
  std::vector<Correspondence> matches;
  GuidedMatcher matcher(switchedOn());
  Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
  matcher.match(features, features, h, matches);
  EXPECT_TRUE(matches.empty());
  h.setConstant(1e300);
  matcher.match(features, features, h, matches);
  EXPECT_TRUE(matches.empty());
  for (const double sign : {1.0, -1.0}) {  // a homography has no sign
    matcher.match(features, features, sign * Eigen::Matrix3d::Identity(), matches);
    EXPECT_EQ(matches.size(), features.size()) << sign;
  }
}

TEST(GuidedMatcher, RefiningSaysWhetherTheHomographyChanged) {
  const Features many = randomFeatures(3, 50, {640, 480});
  Features few = many;  // too few for a homography
  few.keypoints.resize(3);
  few.descriptors = many.descriptors.rowRange(0, 3).clone();
  UncertainHomography h{kShifted};
  std::vector<Correspondence> matches;
  GuidedMatcher matcher(switchedOn());
  EXPECT_FALSE(matcher.refine(few, few, 3.0, false, h, matches));
  EXPECT_EQ(h.homography, kShifted);
  EXPECT_TRUE(h.covariance.isZero());
  EXPECT_TRUE(matcher.refine(many, many, 3.0, false, h, matches));
  EXPECT_EQ(matches.size(), 50u);
  EXPECT_LT((h.homography - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(GuidedMatcher, DoesNothingWhereItIsSwitchedOff) {
  const Features features = randomFeatures(3, 50, {640, 480});
  UncertainHomography h{kShifted};
  std::vector<Correspondence> matches(3);
  GuidedMatcher matcher;
  matcher.match(features, features, h.homography, matches);
  EXPECT_TRUE(matches.empty());
  matches.resize(3);
  EXPECT_FALSE(matcher.refine(features, features, 3.0, false, h, matches));
  EXPECT_TRUE(matches.empty());
  EXPECT_EQ(h.homography, kShifted);
  EXPECT_TRUE(h.covariance.isZero());
}

}  // namespace
}  // namespace ktgp_orb
