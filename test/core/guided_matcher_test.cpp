#include "ktgp_orb/guided_matcher.h"

#include <gtest/gtest.h>

#include <bitset>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/knn/near_kernel.h"
#include "instruction_sets.h"

namespace ktgp_orb {
namespace {

using knn::bestNearKernel;

Features randomFeatures(std::mt19937& generator, int count, const cv::Size& size) {
  // Some lie outside: bad data is legal.
  std::uniform_real_distribution<float> x(-10.F, static_cast<float>(size.width) + 10.F);
  std::uniform_real_distribution<float> y(-10.F, static_cast<float>(size.height) + 10.F);
  std::uniform_int_distribution<int> byte(0, 3);  // few bits differ, and ties are frequent
  Features features;
  features.image_size = size;
  features.descriptors.create(count, kDescriptorBytes, CV_8U);
  for (int i = 0; i < count; ++i) {
    features.keypoints.emplace_back(x(generator), y(generator), 31.F);
    for (int b = 0; b < kDescriptorBytes; ++b) {
      features.descriptors.at<std::uint8_t>(i, b) = static_cast<std::uint8_t>(byte(generator));
    }
  }
  return features;
}

int distance(const Features& a, int i, const Features& b, int j) {
  std::size_t sum = 0;
  for (int k = 0; k < kDescriptorBytes; ++k) {
    sum +=
        std::bitset<8>(a.descriptors.at<std::uint8_t>(i, k) ^ b.descriptors.at<std::uint8_t>(j, k))
            .count();
  }
  return static_cast<int>(sum);
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
  const int rows = static_cast<int>(reference.size());
  const int columns = static_cast<int>(target.size());
  const auto best_reference = [&](int t) {
    int best = -1;
    for (int r = 0; r < rows; ++r) {
      if (near(r, t) &&
          (best < 0 || distance(reference, r, target, t) < distance(reference, best, target, t))) {
        best = r;
      }
    }
    return best;
  };
  const auto best_target = [&](int r) {
    int best = -1;
    for (int t = 0; t < columns; ++t) {
      if (near(r, t) &&
          (best < 0 || distance(reference, r, target, t) < distance(reference, r, target, best))) {
        best = t;
      }
    }
    return best;
  };
  std::vector<Correspondence> matches;
  for (int t = 0; t < columns; ++t) {
    const int r = best_reference(t);
    if (r < 0 || best_target(r) != t) continue;
    const int d = distance(reference, r, target, t);
    if (d > options.max_distance) continue;
    int second = 256;
    for (int other = 0; other < rows; ++other) {
      if (other != r && near(other, t)) {
        second = std::min(second, distance(reference, other, target, t));
      }
    }
    matches.push_back({r, t, d, second, Level::guided});
  }
  return matches;
}

GuidedOptions switchedOn() {
  GuidedOptions options;
  options.enabled = true;
  return options;
}

TEST(GuidedMatcher, EqualsTheDefinition) {
  std::mt19937 generator(1);
  for (const double radius : {1.0, 6.0, 25.0}) {
    for (const int count : {0, 1, 40, 300}) {
      GuidedOptions options = switchedOn();
      options.radius = radius;
      options.max_distance = 28;
      const Features reference = randomFeatures(generator, count, {160, 120});
      const Features target = randomFeatures(generator, count + 13, {160, 120});
      Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
      h << 0.9, -0.1, 11.0, 0.12, 1.05, -7.0, 2e-4, -1e-4, 1.0;
      const std::vector<Correspondence> expected = naive(reference, target, h, options);
      if (count == 300 && radius > 5.0) {
        EXPECT_GT(expected.size(), 10u);
      }
      test::forEachInstructionSet([&] {
        SCOPED_TRACE(std::string(bestNearKernel().name) + ", " + std::to_string(radius) + ", " +
                     std::to_string(count));
        std::vector<Correspondence> matches;
        GuidedMatcher(options).match(reference, target, h, matches);
        ASSERT_EQ(matches.size(), expected.size());
        for (std::size_t i = 0; i < matches.size(); ++i) {
          EXPECT_EQ(matches[i].reference_index, expected[i].reference_index);
          EXPECT_EQ(matches[i].target_index, expected[i].target_index);
          EXPECT_EQ(matches[i].distance, expected[i].distance);
          EXPECT_EQ(matches[i].second_distance, expected[i].second_distance);
          EXPECT_EQ(matches[i].level, Level::guided);
        }
      });
    }
  }
}

TEST(GuidedMatcher, SurvivesAHomographyThatSendsEverythingAway) {
  std::mt19937 generator(2);
  const Features features = randomFeatures(generator, 50, {160, 120});
  std::vector<Correspondence> matches;
  GuidedMatcher matcher(switchedOn());
  Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
  matcher.match(features, features, h, matches);
  EXPECT_TRUE(matches.empty());
  h.setConstant(1e300);
  matcher.match(features, features, h, matches);
  EXPECT_TRUE(matches.empty());
  h = -Eigen::Matrix3d::Identity();  // the identity, but from behind the camera
  matcher.match(features, features, h, matches);
  EXPECT_TRUE(matches.empty());
  matcher.match(features, features, -h, matches);
  EXPECT_EQ(matches.size(), features.size());
}

TEST(GuidedMatcher, RefiningSaysWhetherTheHomographyChanged) {
  std::mt19937 generator(3);
  const Features many = randomFeatures(generator, 50, {640, 480});
  Features few = many;  // too few for a homography
  few.keypoints.resize(3);
  few.descriptors = many.descriptors.rowRange(0, 3).clone();
  Eigen::Matrix3d shifted = Eigen::Matrix3d::Identity();
  shifted(0, 2) = 1.0;
  UncertainHomography h;
  h.homography = shifted;
  std::vector<Correspondence> matches;
  GuidedMatcher matcher(switchedOn());
  EXPECT_FALSE(matcher.refine(few, few, 3.0, h, matches));
  EXPECT_EQ(h.homography, shifted);
  EXPECT_TRUE(h.covariance.isZero());
  EXPECT_TRUE(matcher.refine(many, many, 3.0, h, matches));
  EXPECT_EQ(matches.size(), 50u);
  EXPECT_LT((h.homography - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(GuidedMatcher, DoesNothingWhereItIsSwitchedOff) {
  std::mt19937 generator(4);
  const Features features = randomFeatures(generator, 50, {640, 480});
  Eigen::Matrix3d shifted = Eigen::Matrix3d::Identity();
  shifted(0, 2) = 1.0;
  UncertainHomography h;
  h.homography = shifted;
  std::vector<Correspondence> matches(3);
  GuidedMatcher matcher;
  matcher.match(features, features, h.homography, matches);
  EXPECT_TRUE(matches.empty());
  matches.resize(3);
  EXPECT_FALSE(matcher.refine(features, features, 3.0, h, matches));
  EXPECT_TRUE(matches.empty());
  EXPECT_EQ(h.homography, shifted);
  EXPECT_TRUE(h.covariance.isZero());
}

TEST(GuidedMatcher, RefusesBadOptions) {
  GuidedOptions options;
  options.radius = 0.0;
  EXPECT_THROW(GuidedMatcher{options}, std::invalid_argument);
  options = {};
  options.max_distance = 257;
  EXPECT_THROW(GuidedMatcher{options}, std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb
