// The whole chain on artificial features: no data is needed.

#include "ktgp_orb/ktgp_matcher.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "frame_pair.h"

namespace ktgp_orb {
namespace {

const cv::Size kSize(640, 480);

/// Their first keypoints correspond under a homography.
struct Frames : test::FramePair {
  Eigen::Matrix3d truth;
};

Frames makeFrames(int matching, int others, std::uint32_t seed) {
  test::Numbers numbers(seed);
  const Eigen::Matrix3d truth = test::randomHomography(kSize, 0.05, numbers);
  return {test::drawnPair(matching + others, matching, truth, seed, 0, 12), truth};
}

TEST(KtgpMatcher, TheRatioThresholdIsTheDescriptorsUnlessItIsSet) {
  Frames frames = makeFrames(600, 600, 21);
  for (int i = 0; i < 600; ++i) {  // ratios of all sizes
    for (int bit = 0; bit < i / 6; ++bit) {
      frames.target.descriptors.at<std::uint8_t>(i, bit / 8) ^=
          static_cast<std::uint8_t>(1 << bit % 8);
    }
  }
  KtgpMatcher by_default;
  for (DescriptorKind kind : {DescriptorKind::teblid, DescriptorKind::orb}) {
    frames.reference.descriptor = frames.target.descriptor = kind;
    MatchResult result;
    by_default.match(frames.reference, frames.target, result);
    const auto passed = [&](double threshold) {
      MatcherOptions options;
      options.ratio_threshold = threshold;
      return test::matched(frames, options).stages[1].output;
    };
    EXPECT_EQ(result.stages[1].output, passed(ratioThreshold(kind))) << toString(kind);
    EXPECT_GT(passed(0.8), passed(0.66)) << "they can be told apart";
  }
}

TEST(KtgpMatcher, DoesWhatItsStagesDoInARow) {
  const Frames frames = makeFrames(600, 300, 1);
  MatcherOptions options;
  options.ratio_threshold = 0.95;  // keeps wrong matches for GMS and PROSAC
  KtgpMatcher matcher(options);
  MatchResult result;
  matcher.match(frames.reference, frames.target, result);

  std::vector<Correspondence> expected;
  KnnMatcher(options.knn).match(frames.reference.descriptors, frames.target.descriptors, expected);
  const std::size_t kt = filterByRatio(*options.ratio_threshold, expected);
  const std::size_t ktg =
      GmsFilter(options.gms).filter(frames.reference, frames.target, expected).kept;
  PointPairs pairs;
  for (const Correspondence& c : expected) {
    if (c.level != Level::ktg) continue;
    const cv::Point2f& x = frames.reference.keypoints[std::size_t(c.reference_index)].pt;
    const cv::Point2f& u = frames.target.keypoints[std::size_t(c.target_index)].pt;
    pairs.add({x.x, x.y}, {u.x, u.y}, c.ratio());
  }
  ProsacResult prosac;
  ProsacHomography(options.prosac).estimate(pairs, kSize, prosac);
  ASSERT_EQ(prosac.status, Status::ok);

  ASSERT_EQ(result.status, Status::ok);
  EXPECT_EQ(result.prosac.answer.homography, prosac.answer.homography);
  EXPECT_EQ(result.prosac.mask, prosac.mask);
  ASSERT_EQ(result.correspondences.size(), expected.size());
  std::size_t next = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const Correspondence& c = result.correspondences[i];
    EXPECT_EQ(c.reference_index, expected[i].reference_index);
    EXPECT_EQ(c.target_index, static_cast<std::int32_t>(i));
    EXPECT_EQ(c.distance, expected[i].distance);
    EXPECT_EQ(c.second_distance, expected[i].second_distance);
    const bool inlier = expected[i].level == Level::ktg && prosac.mask[next++] != 0;
    EXPECT_EQ(c.level, inlier ? Level::ktgp : expected[i].level) << i;
  }

  const std::size_t outputs[] = {900, kt, ktg, prosac.inliers};
  const char* const names[] = {"knn", "tf", "gms", "prosac"};
  std::size_t input = 900;
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(result.stages[i].name, std::string(names[i]));
    EXPECT_EQ(result.stages[i].input, input) << names[i];
    EXPECT_EQ(result.stages[i].output, outputs[i]) << names[i];
    EXPECT_GE(result.stages[i].milliseconds, 0.0);
    input = outputs[i];
  }
}

TEST(KtgpMatcher, FindsTheTrueMatchesAndNoOthers) {
  KtgpMatcher matcher;
  MatchResult result;
  std::vector<Correspondence> matches;
  for (std::uint32_t seed = 1; seed <= 10; ++seed) {
    const Frames frames = makeFrames(500, 500, seed);
    matcher.match(frames.reference, frames.target, result);
    ASSERT_EQ(result.status, Status::ok);
    EXPECT_LT(test::cornerError(result.prosac.answer.homography, frames.truth, kSize), 1.0);
    result.surviving(Level::ktgp, matches);
    EXPECT_EQ(matches.size(), result.prosac.inliers);
    EXPECT_GT(matches.size(), 300u);  // GMS needs several matches per cell
    for (const Correspondence& c : matches) {
      EXPECT_EQ(c.reference_index, c.target_index);
      EXPECT_LT(c.target_index, 500);
    }
  }
}

TEST(KtgpMatcher, TakesAPredictionAndRepeatsItself) {
  const Frames frames = makeFrames(500, 200, 3);
  KtgpMatcher matcher;
  MatchResult result;
  MatchResult again;
  matcher.match(frames.reference, frames.target, result);
  matcher.match(frames.target, frames.reference, again);  // fills its buffers
  matcher.match(frames.reference, frames.target, again);
  EXPECT_EQ(again.prosac.answer.homography, result.prosac.answer.homography);
  EXPECT_EQ(again.prosac.mask, result.prosac.mask);
  MatchHints hints;
  hints.prediction = frames.truth;
  matcher.match(frames.reference, frames.target, hints, again);
  ASSERT_EQ(again.status, Status::ok);
  EXPECT_LT(test::cornerError(again.prosac.answer.homography, frames.truth, kSize), 1.0);
  hints.prediction = Eigen::Matrix3d::Constant(std::nan(""));
  EXPECT_THROW(matcher.match(frames.reference, frames.target, hints, again), std::invalid_argument);
}

TEST(KtgpMatcher, SaysWhyThereIsNoHomography) {
  const Frames frames = makeFrames(500, 0, 4);
  KtgpMatcher matcher;
  MatchResult result;
  const auto status = [&](const Features& reference, const Features& target) {
    matcher.match(reference, target, result);
    EXPECT_EQ(countAtLeast(result.correspondences, Level::ktgp), 0u);
    EXPECT_EQ(result.stages[3].output, 0u);
    EXPECT_TRUE(result.prosac.answer.homography.isZero());
    return result.status;
  };
  matcher.match(frames.reference, frames.target, result);
  ASSERT_EQ(result.status, Status::ok);  // and no old result remains
  Features none;
  none.image_size = kSize;
  const Features one = makeFrames(1, 0, 5).reference;
  EXPECT_EQ(status(none, frames.target), Status::too_few_features);
  EXPECT_EQ(status(one, frames.target), Status::too_few_features);
  EXPECT_EQ(status(frames.reference, none), Status::too_few_features);
  EXPECT_EQ(status(none, none), Status::too_few_features);
  EXPECT_EQ(status(frames.reference, makeFrames(0, 500, 6).target), Status::too_few_matches);
}

TEST(KtgpMatcher, RefusesBadOptionsAndMalformedFeatures) {
  MatcherOptions options;
  options.ratio_threshold = 0.0;
  EXPECT_THROW(KtgpMatcher{options}, std::invalid_argument);
  options.ratio_threshold = 1.1;
  EXPECT_THROW(KtgpMatcher{options}, std::invalid_argument);
  const Frames frames = makeFrames(20, 0, 7);
  Features broken = frames.reference;
  broken.keypoints.pop_back();
  KtgpMatcher matcher;
  MatchResult result;
  EXPECT_THROW(matcher.match(broken, frames.target, result), std::invalid_argument);
  EXPECT_THROW(matcher.match(frames.reference, broken, result), std::invalid_argument);
  Features other = frames.target;
  other.descriptor = DescriptorKind::teblid;
  EXPECT_THROW(matcher.match(frames.reference, other, result), std::invalid_argument);
}

TEST(MatchResult, IsThatOfAFrameWithoutAReferenceOnceCleared) {
  MatcherOptions options;
  options.guided.enabled = true;
  const Frames frames = makeFrames(500, 0, 8);
  MatchResult result = test::matched(frames, options);
  ASSERT_EQ(result.status, Status::ok);
  options.guided.enabled = false;
  result.clear(options);
  EXPECT_EQ(result.status, Status::no_reference);
  EXPECT_TRUE(result.correspondences.empty());
  EXPECT_TRUE(result.guided.empty());
  EXPECT_EQ(result.gms.kept, 0u);
  EXPECT_EQ(result.prosac.status, Status::no_model);
  EXPECT_TRUE(result.prosac.mask.empty());
  EXPECT_EQ(result.prosac.inliers, 0u);
  EXPECT_EQ(result.prosac.iterations, 0);
  EXPECT_EQ(result.prosac.stop, ProsacStop::not_run);
  EXPECT_EQ(result.inliers, 0u);
  EXPECT_EQ(result.rmse, 0.0);
  EXPECT_TRUE(result.answer.homography.isZero() && result.prosac.answer.homography.isZero());
  EXPECT_TRUE(result.answer.covariance.isZero() && result.prosac.answer.covariance.isZero());
  for (const StageResult& stage : result.stages) EXPECT_EQ(stage.input + stage.output, 0u);
  EXPECT_EQ(result.stages.size(), 5u);
  EXPECT_NE(result.stage("align"), nullptr);
  EXPECT_EQ(result.milliseconds(), 0.0);
}

}  // namespace
}  // namespace ktgp_orb
