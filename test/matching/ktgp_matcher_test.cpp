// The whole chain on artificial features, and every number in its result: it belongs to the
// published homography, whichever stage found it.

#include "ktgp_orb/ktgp_matcher.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "alignment_scene.h"
#include "frame_pair.h"
#include "ktgp_orb/metrics.h"
#include "one_answer.h"
#include "orb_test_images.h"
#include "plain_search.h"
#include "test_data.h"

namespace ktgp_orb {
namespace {

using test::FramePair;
using test::matched;
using test::Numbers;

const cv::Size kSize(640, 480);

/// Their first keypoints correspond under a homography.
struct Frames : test::FramePair {
  Eigen::Matrix3d truth;
};

Frames makeFrames(int matching, int others, std::uint32_t seed) {
  Numbers numbers(seed);
  const Eigen::Matrix3d truth = test::randomHomography(kSize, 0.05, numbers);
  return {test::drawnPair(matching + others, matching, truth, seed, 0, 12), truth};
}

/// What options() says is what runs: no stage that it leaves out, none more.
TEST(MatcherOptionsTest, TheStagesAreThoseOfTheOptions) {
  for (MatcherOptions options :
       {MatcherOptions::ktgp(), MatcherOptions::robust(), MatcherOptions::slam()}) {
    options.prosac.max_error = 2.5;
    options.guided.radius = 7.0;
    const KtgpMatcher matcher(options);
    const MatcherOptions& running = matcher.options();
    EXPECT_EQ(running.prosac.max_error, 2.5);
    EXPECT_EQ(running.guided.radius, 7.0);
    EXPECT_EQ(running.shared_errors, options.shared_errors);
    MatchResult result;
    result.clear(options);
    EXPECT_EQ(result.stage(StageId::growth) != nullptr, options.growth.enabled);
    EXPECT_EQ(result.stage(StageId::guided) != nullptr, options.guided.enabled);
    EXPECT_EQ(result.stage(StageId::align) != nullptr, options.alignment.enabled);
    EXPECT_EQ(result.stage(StageId::two_view) != nullptr,
              options.geometry != GeometryModel::homography);
  }
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
      return matched(frames, options).stages[1].output;
    };
    EXPECT_EQ(result.stages[1].output, passed(ratioThreshold(kind))) << toString(kind);
    EXPECT_GT(passed(0.8), passed(0.66)) << "they can be told apart";
  }
}

TEST(KtgpMatcher, EqualsItsStagesInARow) {
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
  std::size_t next = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(result.correspondences[i].target_index, static_cast<std::int32_t>(i));
    const bool inlier = expected[i].level == Level::ktg && prosac.mask[next++] != 0;
    if (inlier) expected[i].level = Level::ktgp;
  }
  EXPECT_TRUE(test::same(result.correspondences, expected));

  const std::size_t outputs[] = {900, kt, ktg, prosac.inliers};
  const char* const names[] = {"knn", "tf", "gms", "prosac"};
  std::size_t input = 900;
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_STREQ(toString(result.stages[i].id), names[i]);
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

TEST(KtgpMatcher, PredictionIsUsedAndDeterministic) {
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

TEST(KtgpMatcher, LeavesOutKeypointsWithoutAPosition) {
  for (const MatcherOptions& options :
       {MatcherOptions(), MatcherOptions::robust(), MatcherOptions::slam()}) {
    Frames frames = makeFrames(500, 100, 8);
    for (std::size_t i = 0; i < 600; i += 7) {
      frames.target.keypoints[i].pt = {NAN, NAN};
      frames.reference.keypoints[(i + 3) % 600].pt = {NAN, NAN};
    }
    MatchResult result;
    KtgpMatcher(options).match(frames.reference, frames.target, result);
    ASSERT_EQ(result.status, Status::ok);
    EXPECT_LT(test::cornerError(result.answer.homography, frames.truth, kSize), 1.0);
    for (const Correspondence& c : result.correspondences) {
      if (c.level < Level::ktg) continue;
      EXPECT_FALSE(
          std::isnan(frames.target.keypoints[static_cast<std::size_t>(c.target_index)].pt.x));
    }
  }
}

TEST(KtgpMatcher, RefusesAPredictionThatIsNotFiniteInEveryScene) {
  const Frames frames = makeFrames(500, 0, 3);
  MatchHints hints;
  hints.prediction = Eigen::Matrix3d::Constant(std::nan(""));
  MatchResult result;
  Features none;
  none.image_size = kSize;
  for (const MatcherOptions& options : {MatcherOptions::robust(), MatcherOptions::slam()}) {
    KtgpMatcher matcher(options);
    EXPECT_THROW(matcher.match(frames.reference, frames.target, hints, result),
                 std::invalid_argument);
    EXPECT_THROW(matcher.match(none, none, hints, result), std::invalid_argument);
  }
}

TEST(KtgpMatcher, EveryStageRefusesOtherDescriptors) {
  const Frames frames = makeFrames(50, 0, 7);
  Features other = frames.target;
  other.descriptor = DescriptorKind::teblid;
  std::vector<Correspondence> matches;
  KnnOptions near;
  near.search_radius = 20.0;
  EXPECT_THROW(KnnMatcher(near).matchNear(frames.reference, other, frames.truth, true, matches),
               std::invalid_argument);
  GuidedOptions guided;
  guided.enabled = true;
  EXPECT_THROW(GuidedMatcher(guided).match(frames.reference, other, frames.truth, matches),
               std::invalid_argument);
  GrowthResult grown;
  EXPECT_THROW(HomographyGrowth(MatcherOptions::robust().growth)
                   .find(frames.reference, nullptr, other, matches, std::nullopt, grown),
               std::invalid_argument);
}

TEST(KtgpMatcher, RefusesMalformedFeaturesAndOtherDescriptors) {
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
  EXPECT_THROW(matcher.match(other, frames.target, result), std::invalid_argument);
}

TEST(MatchResult, ClearedEqualsNoReference) {
  MatcherOptions options;
  options.guided.enabled = true;
  const Frames frames = makeFrames(500, 0, 8);
  MatchResult result = matched(frames, options);
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
  EXPECT_NE(result.stage(StageId::align), nullptr);
  EXPECT_EQ(result.milliseconds(), 0.0);
}

// The optional stages after the four, and those of the robust preset.

struct Pair : test::FramePair {
  Eigen::Matrix3d truth;
};

Pair warpedPair(const Eigen::Matrix3d& truth) {
  cv::Mat image;
  cv::GaussianBlur(test::textureImage(cv::Size(640, 480), 1), image, cv::Size(), 1.0);
  return {{image, test::warped(image, truth, image.size())}, truth};
}

double errorOf(const Eigen::Matrix3d& homography, const Pair& pair) {
  return metrics::cornerError(homography, pair.truth, pair.reference.image_size);
}

TEST(MatcherRefinement, AlignmentDoesNotChangeTheFourStages) {
  const Pair pair = warpedPair(test::turn(4.0, 1.03));
  MatcherOptions without;
  without.alignment.enabled = false;
  const MatchResult plain = matched(pair, without);
  const MatchResult aligned = matched(pair, {});
  ASSERT_EQ(plain.status, Status::ok);
  ASSERT_EQ(aligned.status, Status::ok);
  EXPECT_EQ(plain.answer.homography, plain.prosac.answer.homography);
  EXPECT_EQ(plain.answer.covariance, plain.prosac.answer.covariance);
  EXPECT_EQ(plain.inliers, plain.prosac.inliers);
  EXPECT_EQ(aligned.prosac.answer.homography, plain.prosac.answer.homography);
  EXPECT_EQ(aligned.answer.homography, aligned.alignment.answer.homography);
  EXPECT_EQ(aligned.alignment.status, AlignmentStatus::ok);
  EXPECT_LT(errorOf(aligned.answer.homography, pair), 0.05);
  EXPECT_LT(errorOf(aligned.answer.homography, pair), 0.5 * errorOf(plain.answer.homography, pair));
  EXPECT_LT(aligned.alignment.rmse_after, aligned.alignment.rmse_before);
  EXPECT_EQ(plain.rmse, plain.prosac.rmse);
  test::expectOneAnswer(aligned, pair.reference, pair.target, without.prosac.max_error);
  for (std::size_t i = 0; i < plain.stages.size(); ++i) {
    EXPECT_EQ(aligned.stages[i].output, plain.stages[i].output);
  }
  for (std::size_t i = 0; i < plain.correspondences.size(); ++i) {
    const Level before = plain.correspondences[i].level;
    const Level after = aligned.correspondences[i].level;
    EXPECT_EQ(std::min(after, Level::ktg), std::min(before, Level::ktg))
        << "the first three stages";
  }
  EXPECT_EQ(plain.stage(StageId::align), nullptr);
  ASSERT_NE(aligned.stage(StageId::align), nullptr);
  EXPECT_EQ(aligned.stage(StageId::align)->input, aligned.stages[3].output);
  EXPECT_EQ(aligned.stage(StageId::align)->output, aligned.alignment.points.size());
}

TEST(MatcherRefinement, LeavingGmsOutLeavesTheLevelsNested) {
  const Pair pair = warpedPair(test::turn(4.0, 1.03));
  MatcherOptions options;
  options.gms.enabled = false;
  const MatchResult result = matched(pair, options);
  EXPECT_EQ(result.stages[2].output, result.stages[1].output);
  EXPECT_EQ(countAtLeast(result.correspondences, Level::kt), result.stages[1].output);
  EXPECT_EQ(countAtLeast(result.correspondences, Level::ktg), result.stages[1].output);
  EXPECT_EQ(countAtLeast(result.correspondences, Level::ktgp), result.stages[3].output);
}

TEST(MatcherRefinement, GuidedMatchingAddsMatchesOfItsOwnLevel) {
  const Pair pair = warpedPair(test::turn(4.0, 1.03));
  MatcherOptions options;
  options.guided.enabled = true;
  options.alignment.enabled = false;
  const MatchResult result = matched(pair, options);
  ASSERT_EQ(result.status, Status::ok);
  EXPECT_GT(result.guided.size(), 50u);
  EXPECT_EQ(result.inliers, result.stages[3].output + result.guided.size());
  EXPECT_EQ(result.stage(StageId::guided)->output, result.inliers);
  test::expectOneAnswer(result, pair.reference, pair.target, options.prosac.max_error);
}

TEST(MatcherRefinement, RobustPresetFindsMatchesThatGmsLoses) {
  const Pair pair = warpedPair(test::turn(100.0, 1.3));
  EXPECT_NE(matched(pair, MatcherOptions::ktgp()).status, Status::ok);
  const MatchResult robust = matched(pair, MatcherOptions::robust());
  ASSERT_EQ(robust.status, Status::ok);
  EXPECT_LT(errorOf(robust.answer.homography, pair), 0.1);
}

TEST(MatcherRefinement, WithoutAHomographyThereIsNothingToRefine) {
  const Pair pair = warpedPair(test::turn(4.0, 1.03));
  KtgpMatcher matcher(MatcherOptions::robust());
  MatchResult result;
  matcher.match(pair.reference, pair.target, result);
  ASSERT_EQ(result.status, Status::ok);
  Features few = pair.target;
  few.keypoints.resize(3);
  few.descriptors = few.descriptors.rowRange(0, 3).clone();
  matcher.match(pair.reference, few, result);
  EXPECT_NE(result.status, Status::ok);
  EXPECT_TRUE(result.guided.empty());
  EXPECT_EQ(result.alignment.status, AlignmentStatus::not_run);
  EXPECT_TRUE(result.alignment.points.empty());
  EXPECT_TRUE(result.answer.homography.isZero());
  EXPECT_EQ(result.inliers, 0u);
}

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

/// Map -> image of a camera `y` px below the map's upper edge and `height` px above it, that looks
/// up the map and down by `degrees`.
Eigen::Matrix3d cameraOverMap(double y, double height, double degrees) {
  const double t = degrees * M_PI / 180.0;
  Eigen::Matrix3d turn;  // rows: right, down and forward of the camera; z points up from the map
  turn << 1.0, 0.0, 0.0, 0.0, std::sin(t), -std::cos(t), 0.0, -std::cos(t), -std::sin(t);
  Eigen::Matrix3d plane;
  plane << turn.col(0), turn.col(1), -turn * Eigen::Vector3d(300.0, y, height);
  return test::cameraMatrix(500.0, 500.0) * plane;
}

/// The camera's view; grey beyond the horizon and beside the map.
cv::Mat viewOfMap(const cv::Mat& map, const Eigen::Matrix3d& to_image) {
  const cv::Size size(640, 480);
  cv::Mat view = test::warped(map, to_image, size, cv::INTER_LINEAR);
  const Eigen::Matrix3d back = to_image.inverse();
  for (int row = 0; row < size.height; ++row) {
    for (int column = 0; column < size.width; ++column) {
      const Eigen::Vector3d p = back * Eigen::Vector3d(column, row, 1.0);
      const bool is_seen = (to_image * Eigen::Vector3d(p / p.z())).z() > 0.0 &&
                           test::isInside(p.hnormalized(), map.size());
      if (!is_seen) view.at<std::uint8_t>(row, column) = 128;
    }
  }
  return view;
}

// The map goes on behind the camera, or the horizon is in the reference.
TEST(KtgpMatcher, FindsAPlaneThatIsSeenInPart) {
  const cv::Mat map = test::textureImage({600, 600}, 3);
  for (const auto& [y, height, degrees] :
       {std::tuple(400.0, 150.0, 35.0), std::tuple(640.0, 200.0, 20.0),
        std::tuple(300.0, 120.0, 30.0)}) {
    const Eigen::Matrix3d truth = cameraOverMap(y, height, degrees);
    OrbOptions orb;
    orb.max_features = 4000;
    orb.fast_threshold = 10;
    const FramePair pair(map, viewOfMap(map, truth), orb);
    const Eigen::Vector2d on_map(300.0, y - 1.8 * height);
    const Eigen::Vector2d in_view = test::apply(truth, on_map);
    ASSERT_TRUE(test::isInside(in_view, {640, 480}));
    for (const bool is_reversed : {false, true}) {
      FramePair given = pair;
      if (is_reversed) std::swap(given.reference, given.target);
      MatcherOptions options = MatcherOptions::robust();
      options.alignment.enabled = false;
      const MatchResult result = matched(given, options);
      ASSERT_EQ(result.status, Status::ok) << degrees << " " << is_reversed;
      const Eigen::Vector2d& from = is_reversed ? in_view : on_map;
      const Eigen::Vector2d& to = is_reversed ? on_map : in_view;
      EXPECT_LT((test::apply(result.answer.homography, from) - to).norm(), 1.0) << degrees;
      EXPECT_GT(result.guided.size(), 0U) << "on the side of the horizon that is in view";
    }
  }
}

}  // namespace
}  // namespace ktgp_orb
