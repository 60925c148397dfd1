#include "core/orb/uniform.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <opencv2/features2d.hpp>
#include <set>

#include "core/orb/pipeline.h"
#include "instruction_sets.h"
#include "ktgp_orb/orb_extractor.h"
#include "orb_test_images.h"

namespace ktgp_orb::orb {
namespace {

using cv::Size;

constexpr int kStrong = 20;
constexpr int kShare = 8;

// Random corners, more on the left, with scores of 10..59: some are weak.
std::vector<cv::KeyPoint> randomCorners(const Size& size, int count, std::uint64_t seed) {
  cv::RNG rng(seed);
  std::vector<cv::KeyPoint> corners;
  std::set<std::pair<int, int>> taken;
  while (static_cast<int>(corners.size()) < count) {
    const int x = std::min(rng.uniform(kEdgeMargin, size.width - kEdgeMargin),
                           rng.uniform(kEdgeMargin, size.width - kEdgeMargin));
    const int y = rng.uniform(kEdgeMargin, size.height - kEdgeMargin);
    if (!taken.emplace(x, y).second) continue;
    corners.emplace_back(static_cast<float>(x), static_cast<float>(y), 7.f, -1.f,
                         static_cast<float>(rng.uniform(10, 60)));
  }
  return corners;
}

std::vector<int> countPerCell(const LevelCells& grid, const std::vector<cv::KeyPoint>& keypoints) {
  std::vector<int> count(grid.count());
  for (const cv::KeyPoint& keypoint : keypoints) ++count[grid.cellOf(keypoint.pt)];
  return count;
}

struct Chosen {
  std::vector<cv::KeyPoint> keypoints;
  std::vector<int> before;  // corners per cell
  std::vector<int> after;
};

Chosen choose(const cv::Mat& image, int features, std::vector<cv::KeyPoint> corners) {
  const LevelCells grid(image.size(), features, kShare);
  Chosen result;
  result.before = countPerCell(grid, corners);
  UniformChoice choice(features, kStrong, kShare, 1);
  choice.sortIntoCells(0, image.size(), features, corners);
  choice.share(1);
  choice.keepShares(0, image, bestOrbKernels(), corners);
  result.after = countPerCell(grid, corners);
  result.keypoints = corners;
  return result;
}

TEST(UniformChoice, GivesEveryCellAnEqualShareAndLosesNone) {
  const cv::Mat image = test::noiseImage(Size(400, 300), 1);
  for (int count : {0, 1, 5, 50, 200, 500, 1500, 4000}) {
    for (int features : {1, 3, 17, 100, 499, 1000}) {
      const Chosen chosen = choose(image, features, randomCorners(image.size(), count, 2));
      ASSERT_EQ(static_cast<int>(chosen.keypoints.size()), std::min(count, features));
      // Cells with too many corners keep the same number; some keep one more.
      int most = 0;
      for (int kept : chosen.after) most = std::max(most, kept);
      for (std::size_t i = 0; i < chosen.after.size(); ++i) {
        EXPECT_GE(chosen.after[i], std::min(chosen.before[i], most - 1))
            << "cell " << i << " of " << count << " corners for " << features;
      }
    }
  }
}

TEST(UniformChoice, PrefersStrongCornersAndThenHigherHarrisResponses) {
  const cv::Mat image = test::noiseImage(Size(400, 300), 3);
  const int features = 300;
  const std::vector<cv::KeyPoint> corners = randomCorners(image.size(), 2000, 4);
  const Chosen chosen = choose(image, features, corners);
  const LevelCells grid(image.size(), features, kShare);
  const auto key = [](const cv::KeyPoint& k) { return std::make_pair(k.pt.y, k.pt.x); };
  std::map<std::pair<float, float>, float> kept;
  for (const cv::KeyPoint& keypoint : chosen.keypoints) kept[key(keypoint)] = keypoint.response;
  std::vector<bool> keeps_weak(grid.count());
  std::vector<float> least_kept(grid.count(), 1e9f);
  for (const cv::KeyPoint& corner : corners) {
    const auto it = kept.find(key(corner));
    if (it == kept.end()) continue;
    const int cell = grid.cellOf(corner.pt);
    if (corner.response < kStrong) keeps_weak[cell] = true;
    if (corner.response >= kStrong) least_kept[cell] = std::min(least_kept[cell], it->second);
  }
  for (const cv::KeyPoint& corner : corners) {
    if (corner.response < kStrong || kept.count(key(corner)) != 0) continue;
    const int cell = grid.cellOf(corner.pt);
    EXPECT_FALSE(keeps_weak[cell]) << "a weak corner was kept before a strong one";
    EXPECT_LE(harrisResponse(image, portableOrbKernels(), corner.pt), least_kept[cell]);
  }
}

// The right half of the image has less contrast than the left.
cv::Mat halfFaint(const Size& size) {
  cv::Mat image = test::textureImage(size, 5);
  cv::Mat faint = image.colRange(size.width / 2, size.width);
  faint.convertTo(faint, CV_8U, 0.6, 50);
  return image;
}

Features extract(const cv::Mat& image, KeypointDistribution distribution, int threads = 1) {
  OrbOptions options;
  options.max_features = 1000;
  options.distribution = distribution;
  options.threads = threads;
  Features features;
  OrbExtractor(options).extract(image, features);
  return features;
}

TEST(UniformDistribution, FillsTheFaintHalfOfAnImage) {
  const cv::Mat image = halfFaint(Size(640, 480));
  const auto share_of_faint = [&](const Features& features) {
    const auto faint = std::count_if(features.keypoints.begin(), features.keypoints.end(),
                                     [](const cv::KeyPoint& k) { return k.pt.x > 320; });
    return static_cast<double>(faint) / static_cast<double>(features.size());
  };
  EXPECT_LT(share_of_faint(extract(image, KeypointDistribution::ranked)), 0.2);
  EXPECT_GT(share_of_faint(extract(image, KeypointDistribution::uniform)), 0.35);
}

TEST(UniformDistribution, KeepsExactlyAsManyAsWantedWhereTheImageHasThem) {
  for (int features : {1, 100, 777, 2000}) {
    OrbOptions options;
    options.max_features = features;
    options.distribution = KeypointDistribution::uniform;
    Features result;
    OrbExtractor(options).extract(test::textureImage(Size(640, 480), 6), result);
    EXPECT_EQ(static_cast<int>(result.size()), features);
  }
}

TEST(UniformDistribution, IsTheSameForEveryNumberOfThreadsAndInstructionSet) {
  const cv::Mat image = halfFaint(Size(403, 301));
  const Features expected = extract(image, KeypointDistribution::uniform);
  const auto expect_same = [&](const Features& actual) {
    ASSERT_EQ(actual.size(), expected.size());
    for (std::size_t i = 0; i < actual.size(); ++i) {
      ASSERT_EQ(actual.keypoints[i].pt, expected.keypoints[i].pt);
      ASSERT_EQ(actual.keypoints[i].response, expected.keypoints[i].response);
    }
    EXPECT_EQ(cv::norm(actual.descriptors, expected.descriptors, cv::NORM_INF), 0.0);
  };
  for (int threads = 2; threads <= 8; ++threads) {
    expect_same(extract(image, KeypointDistribution::uniform, threads));
  }
  for (const OrbKernels* kernels : test::everyKernels(bestOrbKernels, portableOrbKernels())) {
    OrbOptions options;
    options.max_features = 1000;
    options.distribution = KeypointDistribution::uniform;
    Features features;
    OrbPipeline(options, *kernels).extract(image, cv::Mat(), features);
    expect_same(features);
  }
}

TEST(UniformDistribution, DescribesEachKeypointAsOpencvWould) {
  const cv::Mat image = test::textureImage(Size(500, 400), 7);
  Features features = extract(image, KeypointDistribution::uniform);
  std::vector<cv::KeyPoint> keypoints = features.keypoints;
  cv::Mat expected;
  cv::ORB::create(1000, 1.2f, 8, 31, 0, 2, cv::ORB::HARRIS_SCORE, 31, 20)
      ->compute(image, keypoints, expected);
  ASSERT_EQ(keypoints.size(), features.size());
  EXPECT_EQ(cv::norm(features.descriptors, expected, cv::NORM_INF), 0.0);
}

TEST(UniformDistribution, RespectsTheMask) {
  const cv::Mat image = test::textureImage(Size(400, 300), 8);
  cv::Mat mask = cv::Mat::zeros(image.size(), CV_8U);
  mask(cv::Rect(100, 80, 200, 150)).setTo(255);
  OrbOptions options;
  options.distribution = KeypointDistribution::uniform;
  Features features;
  OrbExtractor(options).extract(image, mask, features);
  EXPECT_GT(features.size(), 50u);
  for (const cv::KeyPoint& keypoint : features.keypoints) {
    EXPECT_TRUE(cv::Rect2f(96, 76, 208, 158).contains(keypoint.pt));
  }
}

TEST(UniformDistribution, FindsNothingOnAFlatImage) {
  Features features;
  OrbOptions options;
  options.distribution = KeypointDistribution::uniform;
  OrbExtractor(options).extract(test::flatImage(Size(300, 200), 9), features);
  EXPECT_TRUE(features.empty());
}

}  // namespace
}  // namespace ktgp_orb::orb
