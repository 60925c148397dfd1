// Every number in a result belongs to the published homography, whichever stage found it.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "frame_pair.h"
#include "one_answer.h"
#include "orb_test_images.h"
#include "test_data.h"

namespace ktgp_orb {
namespace {

using test::FramePair;
using test::matched;
using test::Numbers;

OrbOptions withFeatures(int features) {
  OrbOptions options;
  options.max_features = features;
  return options;
}

/// A textured plane that moves, and a part that moves differently, so that the stages disagree.
FramePair texturedPair(Numbers& numbers, int seed) {
  const cv::Size size(320, 240);
  cv::Mat image;
  cv::GaussianBlur(test::textureImage(size, seed), image, cv::Size(), 1.0);
  cv::Mat target = test::warped(image, test::randomHomography(size, 0.08, numbers), size);
  const cv::Rect part(40, 40, 120, 90);
  cv::Mat moved;
  const cv::Mat shift = (cv::Mat_<double>(2, 3) << 1, 0, numbers.uniform(0.5, 6.0), 0, 1, 2.0);
  cv::warpAffine(target, moved, shift, size, cv::INTER_CUBIC);
  moved(part).copyTo(target(part));
  return {image, target, withFeatures(500)};
}

MatcherOptions drawnOptions(Numbers& numbers) {
  const auto coin = [&] { return numbers.uniform(0.0, 1.0) < 0.5; };
  MatcherOptions options = coin() ? MatcherOptions::ktgp() : MatcherOptions::robust();
  options.guided.enabled = coin();
  options.alignment.enabled = numbers.uniform(0.0, 1.0) < 0.8;
  options.prosac.max_error = numbers.uniform(0.5, 5.0);
  options.prosac.seed = static_cast<std::uint64_t>(numbers.uniform(0.0, 1e6));
  return options;
}

/// Counts the labels that changed after PROSAC, so that the test is not void.
std::size_t expectOneAnswer(const FramePair& pair, const MatcherOptions& options,
                            const MatchResult& result) {
  test::expectOneAnswer(result, pair.reference, pair.target, options.prosac.max_error);
  std::size_t relabelled = 0;
  std::size_t place = 0;
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktg) continue;
    if ((c.level == Level::ktgp) != (result.prosac.mask[place++] != 0)) ++relabelled;
  }
  EXPECT_EQ(result.stages[3].output, result.prosac.inliers) << "the stage says what it passed on";
  return relabelled;
}

TEST(OneAnswer, LabelsInliersAndRmseBelongToThePublishedHomography) {
  constexpr int kPairs = 40;
  constexpr int kSettings = 25;
  Numbers numbers(3);
  std::size_t found = 0;
  std::size_t relabelled = 0;
  for (int i = 0; i < kPairs; ++i) {
    const FramePair pair = texturedPair(numbers, i);
    for (int k = 0; k < kSettings; ++k) {
      const MatcherOptions options = drawnOptions(numbers);
      const MatchResult result = matched(pair, options);
      if (result.status != Status::ok) continue;
      ++found;
      relabelled += expectOneAnswer(pair, options, result);
    }
  }
  EXPECT_GT(found, 700u);
  EXPECT_GT(relabelled, 500u);
}

TEST(OneAnswer, OnRealPairs) {
  KTGP_ORB_REQUIRE_FOLDER(test::dataFolder(), "KTGP_ORB_DATA");
  Numbers numbers(4);
  std::size_t relabelled = 0;
  for (const char* set : {"leuven", "bikes", "boat"}) {
    for (int i = 2; i <= 6; ++i) {
      const FramePair pair(test::oxfordImage(set, 1), test::oxfordImage(set, i),
                           withFeatures(2000));
      for (int k = 0; k < 4; ++k) {
        const MatcherOptions options = drawnOptions(numbers);
        const MatchResult result = matched(pair, options);
        if (result.status == Status::ok) relabelled += expectOneAnswer(pair, options, result);
      }
    }
  }
  EXPECT_GT(relabelled, 50u);
}

TEST(OneAnswer, WithoutRefinementsAllIsProsacs) {
  Numbers numbers(5);
  MatcherOptions options;
  options.alignment.enabled = false;
  const FramePair pair = texturedPair(numbers, 7);
  const MatchResult result = matched(pair, options);
  ASSERT_EQ(result.status, Status::ok);
  EXPECT_EQ(result.answer.homography, result.prosac.answer.homography);
  EXPECT_EQ(result.answer.covariance, result.prosac.answer.covariance);
  EXPECT_EQ(result.inliers, result.prosac.inliers);
  EXPECT_EQ(result.rmse, result.prosac.rmse);
}

}  // namespace
}  // namespace ktgp_orb
