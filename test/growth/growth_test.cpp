// The growth of a homography from single matches: on drawn keypoints with known truth, on data
// without any, and in the matcher.
#include "ktgp_orb/growth.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "drawn_pages.h"
#include "frame_pair.h"
#include "growth/local_frame.h"
#include "growth/local_matcher.h"
#include "growth/map_fit.h"
#include "growth/single_details.h"
#include "growth/verdict.h"
#include "growth/votes.h"
#include "ktgp_orb/knn_matcher.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/sequence_matcher.h"
#include "one_answer.h"
#include "orb_test_images.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using test::drawnPair;
using test::FramePair;
using test::matched;
using test::Numbers;

const cv::Size kSize(640, 480);

Eigen::Matrix3d tilted() {
  return (Eigen::Matrix3d() << 0.9, -0.35, 120.0, 0.3, 0.75, 10.0, 2e-4, 3e-4, 1.0).finished();
}

std::vector<Correspondence> mutualMatches(const FramePair& pair) {
  std::vector<Correspondence> matches;
  KnnMatcher().matchMutual(pair.reference.descriptors, pair.target.descriptors, matches);
  return matches;
}

GrowthResult grow(const FramePair& pair, const GrowthOptions& options = {}) {
  GrowthResult result;
  HomographyGrowth(options).find(pair.reference, nullptr, pair.target, mutualMatches(pair), result);
  return result;
}

TEST(Growth, FindsAHomographyOfTwoPercentOfTheKeypoints) {
  int found = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const GrowthResult result = grow(drawnPair(2000, 40, tilted(), seed));
    if (!result.found) continue;
    ++found;
    EXPECT_LT(test::cornerError(result.answer.homography, tilted(), kSize), 6.0) << seed;
    EXPECT_GE(result.pairs.size(), 20U);
    EXPECT_EQ(result.answer.homography(2, 2), 1.0);
    EXPECT_GT(result.answer.covariance.diagonal().minCoeff(), 0.0);
    EXPECT_LT(result.log_false_alarms, growth::Verdict::kLogMaxFalseAlarms);
  }
  EXPECT_GE(found, 18);
}

TEST(Growth, FindsNoHomographyOfUnrelatedKeypoints) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const GrowthResult result = grow(drawnPair(1000, 0, tilted(), seed));
    EXPECT_FALSE(result.found) << seed;
    EXPECT_TRUE(result.answer.homography.isZero());
    EXPECT_EQ(result.pairs.size(), 0U);
  }
}

/// Letters of one alphabet at random positions: parts agree everywhere.
cv::Mat letters(std::uint64_t seed) {
  Numbers numbers(seed);
  cv::Mat image(kSize, CV_8U, cv::Scalar(230));
  for (int row = 0; row < 14; ++row) {
    for (int column = 0; column < 22; ++column) {
      const std::string letter(1,
                               static_cast<char>('A' + static_cast<int>(numbers.uniform(0, 26))));
      cv::putText(image, letter, {column * 28 + 8, row * 33 + 28}, cv::FONT_HERSHEY_SIMPLEX, 0.9,
                  cv::Scalar(20), 2, cv::LINE_AA);
    }
  }
  return image;
}

TEST(Growth, DoesNotMatchDifferentTextsOfOneFont) {
  OrbOptions orb;
  orb.fast_threshold = 10;
  MatchResult result;
  KtgpMatcher matcher(MatcherOptions::robust());
  int tried = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const FramePair pair(letters(seed), letters(seed + 100), orb);
    matcher.match(pair.reference, pair.target, result);
    EXPECT_NE(result.status, Status::ok) << seed;
    EXPECT_EQ(result.found_by, FoundBy::none);
    tried += result.growth.seeds;
  }
  EXPECT_GT(tried, 0);
}

// Thousands of keypoints agree with a shift by one symbol or more; more such pairs are in the
// long tests.
TEST(GrowthPages, ThatShareOnlySymbolsAreNotFound) {
  EXPECT_EQ(test::countPages(0.0, 1, 4).found, 0);
}

TEST(GrowthPages, AreFoundByWhatExistsOnceInTheOverlap) {
  const test::PageCounts counts = test::countPages(0.3, 1, 4);
  EXPECT_EQ(counts.wrong, 0);
  EXPECT_GE(counts.found, 0.95 * counts.pairs);
}

TEST(GrowthPages, WithASmallOverlapAreRightOrNotFound) {
  EXPECT_EQ(test::countPages(0.15, 1, 3).wrong, 0);
}

// Both pages are turned by nearly the same angle, so one of the shifts samples all symbols at the
// same positions between the pixels. More nearest neighbours vote for this shift than for any
// other. In the texts, no shift has many votes, but one has more matches than chance explains.
TEST(GrowthPages, WhoseSymbolsAreSampledAlikeAreNotFound) {
  KtgpMatcher matcher(MatcherOptions::robust());
  MatchResult result;
  for (const auto& [page, seed] : {std::pair{test::Page::form, 37},
                                   {test::Page::facade, 26},
                                   {test::Page::facade, 76},
                                   {test::Page::circuit, 26},
                                   {test::Page::diagram, 31},
                                   {test::Page::diagram, 52},
                                   {test::Page::text, 23},
                                   {test::Page::text, 26}}) {
    const auto pair = test::scannedPair(page, 0.0, seed, test::pageFeatures());
    matcher.match(pair.frames.reference, pair.frames.target, result);
    EXPECT_NE(result.status, Status::ok) << test::nameOf(page) << seed;
    EXPECT_TRUE(result.growth.is_repetitive) << test::nameOf(page) << seed;
  }
}

/// Two frames in which `symbols` copies of one keypoint lie on a grid of 20 px, and `single`
/// keypoints differ from all others. `to`: px of the reference to px of the target.
FramePair symbolsAndDetails(int symbols, int single, const Eigen::Vector2d& to) {
  constexpr int kColumns = 25;
  Numbers numbers(1);
  const auto anyBits = [&] {
    std::vector<std::uint8_t> bits(kDescriptorBytes);
    for (std::uint8_t& b : bits) b = static_cast<std::uint8_t>(numbers.uniform(0.0, 256.0));
    return bits;
  };
  const std::vector<std::uint8_t> symbol = anyBits();
  FramePair pair;
  pair.reference.image_size = pair.target.image_size = kSize;
  for (int i = 0; i < symbols + single; ++i) {
    const Eigen::Vector2d at(20.0 + 20.0 * (i % kColumns), 20.0 + 20.0 * (i / kColumns));
    const std::vector<std::uint8_t> bits = i < symbols ? symbol : anyBits();
    test::addKeypoint(at, 0.0, 31.0, bits, pair.reference);
    test::addKeypoint(at + to, 0.0, 31.0, bits, pair.target);
  }
  return pair;
}

TEST(GrowthDetails, AreFoundWithTheRightMapAndNotAfterAShiftByAPeriod) {
  const Eigen::Vector2d to(7.0, 3.0);
  const FramePair pair = symbolsAndDetails(200, 100, to);
  growth::SingleDetails details;
  details.setFrames(pair.reference, pair.target);
  const auto right = details.count(test::translation(to.x(), to.y()));
  const auto shifted = details.count(test::translation(to.x() + 20.0, to.y()));
  ASSERT_TRUE(right && shifted);
  EXPECT_EQ(right->share(), 1.0);
  EXPECT_TRUE(right->settle());
  EXPECT_EQ(shifted->share(), 0.0);
  EXPECT_TRUE(shifted->contradict());
}

TEST(GrowthDetails, DoNotTellInAPictureThatIsNotRepetitive) {
  const FramePair pair = symbolsAndDetails(100, 200, {0.0, 0.0});
  growth::SingleDetails details;
  details.setFrames(pair.reference, pair.target);
  EXPECT_FALSE(details.count(Eigen::Matrix3d::Identity()));
}

// One page is scanned at 150 dpi, the other one at 400 dpi or photographed from near.
TEST(GrowthPages, OfDifferentScaleThatShareOnlySymbolsAreNotFound) {
  EXPECT_EQ(test::countPages(0.0, 1, 3, test::fineScan()).found, 0);
  EXPECT_EQ(test::countPages(0.0, 1, 3, test::nearPhotograph()).found, 0);
}

// The chips and most tables have too few details that the coarse scan resolves.
TEST(GrowthPages, OfDifferentScaleAreFoundByWhatExistsOnceInTheOverlap) {
  for (const test::Scan& second : {test::fineScan(), test::nearPhotograph()}) {
    const test::PageCounts counts = test::countPages(0.3, 1, 3, second);
    EXPECT_EQ(counts.wrong, 0);
    EXPECT_GE(counts.found, 0.6 * counts.pairs);
  }
}

// The most significant hypotheses are rivalled. Those with a small overlap have few votes.
TEST(GrowthPages, ThatShareOnlySymbolsAreNotFoundInASmallOverlap) {
  KtgpMatcher matcher(MatcherOptions::robust());
  MatchResult result;
  for (const auto& [page, seed] :
       {std::pair{test::Page::facade, 106}, {test::Page::diagram, 105}}) {
    const auto pair = test::scannedPair(page, 0.0, seed, test::pageFeatures());
    matcher.match(pair.frames.reference, pair.frames.target, result);
    EXPECT_NE(result.status, Status::ok) << test::nameOf(page);
  }
}

/// A picture without repetition.
cv::Mat scene(std::uint64_t seed) {
  cv::Mat image;
  cv::GaussianBlur(test::blockImage(kSize * 2, seed, 800), image, {}, 1.0);
  return image;
}

TEST(Growth, TriesNoMoreSeedsThanAllowed) {
  GrowthOptions options;
  options.seeds = 3;
  const FramePair pair(letters(1), letters(2));
  EXPECT_EQ(grow(pair, options).seeds, 3);
  options.seeds = 5;
  EXPECT_EQ(grow(pair, options).seeds, 5);
}

TEST(Growth, GivesTheSameAnswerAgain) {
  const FramePair one = drawnPair(2000, 40, tilted(), 3);
  const FramePair other = drawnPair(900, 0, tilted(), 4);
  HomographyGrowth growth;
  GrowthResult first, between, again;
  growth.find(one.reference, nullptr, one.target, mutualMatches(one), first);
  growth.find(other.reference, nullptr, other.target, mutualMatches(other), between);
  growth.find(one.reference, nullptr, one.target, mutualMatches(one), again);
  ASSERT_TRUE(first.found);
  EXPECT_EQ(first.answer.homography, again.answer.homography);
  EXPECT_EQ(first.answer.covariance, again.answer.covariance);
  EXPECT_EQ(first.seeds, again.seeds);
}

TEST(Growth, TakesKeypointsWithoutPlaceOrSizeAndFramesWithout) {
  FramePair pair = drawnPair(300, 0, tilted(), 5);
  pair.reference.keypoints[3].pt.x = -1e6F;
  pair.target.keypoints[4].pt.y = 1e7F;
  pair.target.keypoints[5].size = 0.F;
  pair.reference.keypoints[6].angle = -1.F;
  EXPECT_FALSE(grow(pair).found);
  pair = {};
  pair.reference.image_size = pair.target.image_size = kSize;
  EXPECT_FALSE(grow(pair).found);
}

TEST(Growth, TheMatcherUsesItIfProsacFindsNothing) {
  const FramePair pair = drawnPair(2000, 40, tilted(), 3, 100);
  MatcherOptions options = MatcherOptions::robust();
  options.alignment.enabled = false;
  options.prosac.max_iterations = 20;  // all spent on the lures
  options.growth.enabled = false;
  MatchResult result = matched(pair, options);
  ASSERT_NE(result.status, Status::ok);
  EXPECT_EQ(result.found_by, FoundBy::none);
  options.growth.enabled = true;
  result = matched(pair, options);
  ASSERT_EQ(result.status, Status::ok);
  EXPECT_EQ(result.found_by, FoundBy::growth);
  EXPECT_GT(result.growth.seeds, 0);
  const StageResult& stage = *result.stage(StageId::growth);
  EXPECT_EQ(stage.output, result.growth.pairs.size());
  EXPECT_GT(stage.milliseconds, 0.0);
  double others = -stage.milliseconds;  // its time is part of the total
  for (const StageResult& s : result.stages) others += s.milliseconds;
  EXPECT_NEAR(result.milliseconds(), others + stage.milliseconds, 1e-9);
  EXPECT_LT(test::cornerError(result.answer.homography, tilted(), kSize), 6.0);
  EXPECT_EQ(result.inliers,
            countAtLeast(result.correspondences, Level::ktgp) + result.guided.size());
  const FramePair easy = drawnPair(500, 400, tilted(), 3);
  options.prosac.max_iterations = 2000;
  for (const FramePair& clear : {easy, drawnPair(60, 30, tilted(), 3)}) {  // also few, but most
    result = matched(clear, options);
    EXPECT_EQ(result.found_by, FoundBy::prosac);
    EXPECT_EQ(result.growth.seeds, 0);
  }
}

TEST(Growth, KeepsNoMatchesForTheNextPair) {
  MatcherOptions options = MatcherOptions::robust();
  options.guided.enabled = options.alignment.enabled = false;
  options.prosac.max_iterations = 20;
  KtgpMatcher matcher(options);
  MatchResult result;
  const FramePair hard = drawnPair(2000, 40, tilted(), 3, 100);
  matcher.match(hard.reference, hard.target, result);
  ASSERT_EQ(result.found_by, FoundBy::growth);
  // The pairs of the growth are right here, too, but do not match.
  const FramePair easy = drawnPair(2000, 1000, tilted(), 3);
  easy.target.descriptors.rowRange(0, 40).setTo(0);
  matcher.match(easy.reference, easy.target, result);
  ASSERT_EQ(result.found_by, FoundBy::prosac);
  EXPECT_TRUE(result.guided.empty());
  EXPECT_EQ(result.inliers, result.prosac.inliers);
}

/// 25 of 400 matches lie where one homography puts them, and have the nearest descriptors.
FramePair doubtfulPair(bool with_directions) {
  const Eigen::Matrix3d truth = tilted();
  FramePair pair = drawnPair(1500, with_directions ? 25 : 0, truth, 3, with_directions ? 375 : 400);
  Numbers numbers(4);
  for (int i = 0; i < 400; ++i) {
    auto& target = pair.target.keypoints[static_cast<std::size_t>(i)].pt;
    const cv::Point2f at = pair.reference.keypoints[static_cast<std::size_t>(i)].pt;
    const Eigen::Vector2d u = (truth * Eigen::Vector3d(at.x, at.y, 1.0)).hnormalized();
    if (i < 25 && !with_directions) target = cv::Point2f(cv::Point2d(u.x(), u.y()));
    for (int flips = 0; i >= 25 && flips < 40; ++flips) {
      const auto bit = static_cast<int>(numbers.uniform(0.0, 256.0));
      pair.target.descriptors.at<std::uint8_t>(i, bit / 8) ^=
          static_cast<std::uint8_t>(1U << (bit % 8));
    }
  }
  return pair;
}

TEST(Growth, JudgesProsacsHomographyIfFewMatchesAgree) {
  MatcherOptions options = MatcherOptions::robust();
  options.alignment.enabled = false;
  for (const bool with_directions : {false, true}) {
    const FramePair pair = doubtfulPair(with_directions);
    options.growth.enabled = false;
    MatchResult result = matched(pair, options);
    ASSERT_EQ(result.found_by, FoundBy::prosac);
    ASSERT_LT(result.prosac.inliers, 50U);
    options.growth.enabled = true;
    result = matched(pair, options);
    // The keypoints' directions and sizes do not agree with a homography that is due to chance.
    EXPECT_EQ(result.status, with_directions ? Status::ok : Status::model_rejected);
    EXPECT_EQ(result.found_by, with_directions ? FoundBy::growth : FoundBy::none);
    if (with_directions) continue;
    EXPECT_TRUE(result.answer.homography.isZero());
    EXPECT_EQ(result.inliers, 0U);
    EXPECT_EQ(countAtLeast(result.correspondences, Level::ktgp), 0U);
  }
}

// Growth needs the matches of the whole image to judge a homography. A search near a prediction
// does not have them.
TEST(Growth, FewMatchesOfANearSearchAreRejected) {
  const FramePair pair = doubtfulPair(true);
  MatcherOptions options = MatcherOptions::robust();
  options.knn.search_radius = 10000.0;
  MatchHints hints;
  hints.prediction = tilted();
  for (const bool grows : {false, true}) {
    options.growth.enabled = grows;
    KtgpMatcher matcher(options);
    MatchResult result;
    matcher.match(pair.reference, pair.target, hints, result);
    EXPECT_EQ(result.search, Search::near);
    EXPECT_EQ(result.status, grows ? Status::model_rejected : Status::ok);
    EXPECT_EQ(result.found_by, grows ? FoundBy::none : FoundBy::prosac);
    EXPECT_EQ(result.answer.homography.isZero(), grows);
  }
  hints.whole_image = true;
  MatchResult result;
  KtgpMatcher(options).match(pair.reference, pair.target, hints, result);
  EXPECT_EQ(result.found_by, FoundBy::growth);
}

TEST(Growth, AnswerDoesNotDependOnOtherCalls) {
  const FramePair pair = drawnPair(2000, 40, tilted(), 3, 100);
  for (const bool gms : {false, true}) {
    for (const bool guided : {false, true}) {
      for (const double max_error : {0.3, 3.0}) {
        MatcherOptions options = MatcherOptions::robust();
        options.gms.enabled = gms;
        options.guided.enabled = guided;
        options.prosac.max_error = max_error;
        options.prosac.max_iterations = 20;  // all spent on the lures
        const MatchResult result = matched(pair, options);
        ASSERT_EQ(result.found_by, FoundBy::growth);
        EXPECT_EQ(result.status, Status::ok);
        EXPECT_GE(result.inliers, max_error < 1.0 ? 4U : 20U);
        EXPECT_GT(result.answer.covariance.diagonal().minCoeff(), 0.0);
        test::expectOneAnswer(result, pair.reference, pair.target, max_error);
        if (guided) continue;
        EXPECT_EQ(result.answer.homography, result.growth.answer.homography);
        EXPECT_EQ(result.answer.covariance, result.growth.answer.covariance);
      }
    }
  }
}

TEST(Growth, OnlyTheRobustOptionsEnableIt) {
  EXPECT_FALSE(MatcherOptions().growth.enabled);
  EXPECT_FALSE(MatcherOptions::ktgp().growth.enabled);
  EXPECT_TRUE(MatcherOptions::robust().growth.enabled);
}

TEST(Growth, NotUsedOnThePreviousFrame) {
  const FramePair pair = drawnPair(2000, 40, tilted(), 3, 100);
  SequenceOptions options;
  options.matcher = MatcherOptions::robust();
  options.matcher.prosac.max_iterations = 20;  // all spent on the lures
  for (const ReferenceMode mode : {ReferenceMode::previous, ReferenceMode::keyframe}) {
    options.reference.mode = mode;
    SequenceMatcher sequence(options);
    sequence.match(pair.reference, 0.0);
    const MatchResult& result = sequence.match(pair.target, 0.1).match;
    EXPECT_EQ(result.found_by, mode == ReferenceMode::previous ? FoundBy::none : FoundBy::growth);
  }
}

TEST(GrowthViews, CountEqualsFittingTilts) {
  OrbOptions orb;
  orb.max_features = 500;
  const cv::Mat image = scene(7);
  EXPECT_EQ(simulateViews(image, orb, 0).size(), 0U);
  EXPECT_EQ(simulateViews(image, orb, 4).size(), 0U);
  EXPECT_EQ(simulateViews(image, orb, 5).size(), 4U);
  const ReferenceViews views = simulateViews(image, orb, 13);
  ASSERT_EQ(views.size(), 12U);
  for (const ReferenceView& view : views) {
    for (const cv::KeyPoint& k : view.features.keypoints) {
      const Eigen::Vector2d p = view.to_view.leftCols<2>().inverse() *
                                (Eigen::Vector2d(k.pt.x, k.pt.y) - view.to_view.col(2));
      EXPECT_TRUE(test::isInside(p, image.size()));
    }
  }
  EXPECT_THROW(simulateViews(image, orb, -1), std::invalid_argument);
}

// Rotated by 45 degrees, a tape would fill a square as long as itself. A large reference is shown
// smaller: its views have a bound.
TEST(GrowthViews, OfALongOrLargeReferenceAreHardlyLargerThanItselfOrSmaller) {
  OrbOptions orb;
  orb.max_features = 500;
  for (const cv::Size& size : {cv::Size(6000, 120), cv::Size(120, 5000), cv::Size(40000, 120),
                               cv::Size(4000, 3000), cv::Size(9000, 1200)}) {
    cv::Mat image;
    cv::repeat(scene(7)(cv::Rect(0, 0, 600, 600)), size.height / 600 + 1, size.width / 600 + 1,
               image);
    image = image(cv::Rect({0, 0}, size)).clone();
    const ReferenceViews views = simulateViews(image, orb, 13);
    ASSERT_EQ(views.size(), 12U);
    std::size_t features = 0;
    for (const ReferenceView& view : views) {
      EXPECT_LT(view.features.image_size.area(), 2 * std::min(size.area(), 2500 * 2500)) << size;
      features += view.features.size();
      for (const cv::KeyPoint& k : view.features.keypoints) {
        const Eigen::Vector2d p = view.to_view.leftCols<2>().inverse() *
                                  (Eigen::Vector2d(k.pt.x, k.pt.y) - view.to_view.col(2));
        EXPECT_TRUE(test::isInside(p, size));
      }
    }
    EXPECT_GT(features, 0U);
  }
}

TEST(GrowthViews, OfALongReferenceFindItFromTheSide) {
  cv::Mat tape;
  cv::resize(scene(9)(cv::Rect(0, 0, 1200, 200)), tape, {2400, 400}, 0.0, 0.0, cv::INTER_LINEAR);
  cv::GaussianBlur(tape, tape, {}, 0.6);
  for (const double angle : {0.0, 0.8}) {
    const double c = std::cos(angle), s = std::sin(angle);
    Eigen::Matrix3d truth;  // compressed to a third across `angle`
    truth << c / 3.0, -s / 3.0, 40.0, s, c, -200.0 + 300.0 * c, 0.0, 0.0, 1.0;
    truth = truth * test::translation(-600.0, 0.0);
    truth(0, 2) += 200.0;
    const FramePair pair(tape, test::warped(tape, truth, {640, 640}, cv::INTER_AREA));
    const ReferenceViews views = simulateViews(tape, {}, 13);
    MatchHints hints;
    hints.views = &views;
    const MatchResult result = matched(pair, MatcherOptions::robust(), hints);
    ASSERT_EQ(result.status, Status::ok) << angle;
    const Eigen::Vector2d shown = test::apply(truth.inverse(), {320.0, 320.0});
    EXPECT_LT((test::apply(result.answer.homography, shown) - Eigen::Vector2d(320.0, 320.0)).norm(),
              2.0);
  }
}

TEST(GrowthViews, TakeAtMostThreeMegabytes) {
  OrbOptions orb;
  orb.max_features = 2000;
  orb.fast_threshold = 5;  // as many as wanted
  cv::Mat image;
  cv::resize(scene(7), image, kSize, 0.0, 0.0, cv::INTER_AREA);
  std::size_t bytes = 0;
  std::size_t features = 0;
  for (const ReferenceView& view : simulateViews(image, orb, 13)) {
    features += view.features.size();
    bytes += sizeof(view) + view.features.keypoints.capacity() * sizeof(cv::KeyPoint) +
             view.features.descriptors.total();
    EXPECT_TRUE(view.features.images.empty());
  }
  EXPECT_GT(features, 4000U);
  EXPECT_LT(bytes, 3U << 20U);
}

/// Looks the same after a quarter of a turn about its middle, like a rose window.
cv::Mat rose(std::uint64_t seed) {
  constexpr int kHalf = 240;
  cv::Mat window(2 * kHalf, 2 * kHalf, CV_8U);
  cv::Mat quarter = scene(seed)(cv::Rect(0, 0, kHalf, kHalf)).clone();
  for (const cv::Point corner :
       {cv::Point(0, 0), cv::Point(1, 0), cv::Point(1, 1), cv::Point(0, 1)}) {
    quarter.copyTo(window(cv::Rect(corner * kHalf, quarter.size())));
    cv::rotate(quarter, quarter, cv::ROTATE_90_CLOCKWISE);
  }
  cv::Mat image(kSize, CV_8U, cv::Scalar(128));
  window.copyTo(image(cv::Rect((kSize.width - 2 * kHalf) / 2, 0, 2 * kHalf, 2 * kHalf)));
  return image;
}

/// The turned window is no decoy: no shift of one answer is another one. Only the rule on rivals
/// knows that neither is certainly right.
TEST(Growth, GivesNoHomographyIfTwoAreEquallyGood) {
  const cv::Mat window = rose(11);
  const cv::Point2f middle(319.5F, 239.5F);
  cv::Mat shown;
  cv::warpAffine(window, shown, cv::getRotationMatrix2D(middle, 45.0, 0.8), kSize, cv::INTER_LINEAR,
                 cv::BORDER_CONSTANT, cv::Scalar(128));
  const GrowthResult result = grow({window, shown});
  EXPECT_GT(result.judged, 1);
  EXPECT_LT(result.log_false_alarms, growth::Verdict::kLogMaxFalseAlarms);
  EXPECT_FALSE(result.found);

  // The same with something that only one turn explains.
  const cv::Mat sign = scene(12)(cv::Rect(0, 0, 200, 200));
  sign.copyTo(window(cv::Rect(100, 20, 200, 200)));
  cv::warpAffine(window, shown, cv::getRotationMatrix2D(middle, 45.0, 0.8), kSize, cv::INTER_LINEAR,
                 cv::BORDER_CONSTANT, cv::Scalar(128));
  EXPECT_TRUE(grow({window, shown}).found);
}

TEST(GrowthViews, ShowWhatATiltOfSeventyDegreesHides) {
  cv::Mat reference_image;
  cv::resize(scene(7), reference_image, kSize, 0.0, 0.0, cv::INTER_AREA);
  const Eigen::Matrix3d truth =
      (Eigen::Matrix3d() << 0.28, 0.05, 180.0, 0.0, 0.95, 10.0, 1e-4, 0.0, 1.0).finished();
  cv::Mat blurred;
  cv::GaussianBlur(reference_image, blurred, cv::Size(0, 1), 1.8, 1e-6);
  const FramePair pair(reference_image, test::warped(blurred, truth, kSize, cv::INTER_LINEAR));
  EXPECT_NE(matched(pair, MatcherOptions::robust()).status, Status::ok);
  const ReferenceViews views = simulateViews(reference_image, {}, 13);
  MatchHints hints;
  hints.views = &views;
  const MatchResult result = matched(pair, MatcherOptions::robust(), hints);
  ASSERT_EQ(result.status, Status::ok);
  EXPECT_EQ(result.found_by, FoundBy::growth);
  EXPECT_LT(test::cornerError(result.answer.homography, truth, kSize), 5.0);
}

}  // namespace
}  // namespace ktgp_orb

namespace ktgp_orb::growth {
namespace {

// The parts of the growth beside plain programs that do the same.

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

TEST(GrowthVotes, VotersMatchDefinition) {
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

TEST(GrowthVotes, ClusterHasOneVote) {
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

TEST(GrowthVotes, StopAtEnoughAndKeepToTheReach) {
  const auto at = [](double x) {
    return FramePair{frameAt({x, 100}, 0, 31), frameAt({x + 100, 200}, 0, 31)};
  };
  Votes votes;
  count({at(20), at(60), at(100), at(220.5)}, votes);
  EXPECT_EQ(votes.votes(), (std::vector<std::int32_t>{2, 2, 2, 0}));
  votes.count(kSize, kSize, 1);
  EXPECT_EQ(votes.votes(), (std::vector<std::int32_t>{1, 1, 1, 0}));
  votes.count(kSize, kSize, Votes::kAll, 130.F);
  EXPECT_EQ(votes.votes(), (std::vector<std::int32_t>{2, 2, 3, 1}));
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

TEST(GrowthVerdict, ChanceOfManyIsSmallAndGrowsWithTheSpread) {
  EXPECT_EQ(logChance(3.0, 4.0, 1.0), 0.0);
  // P(Poisson(1) >= 10) = 1.1e-7; the bound lies above it, within two orders.
  EXPECT_NEAR(logChance(10.0, 1.0, 1.0), -6.1, 0.1);
  EXPECT_GT(logChance(10.0, 1.0, 3.0), logChance(10.0, 1.0, 1.0));
  EXPECT_GT(logChance(10.0, 2.0, 1.0), logChance(10.0, 1.0, 1.0));
}

TEST(GrowthFit, RecoversExactMaps) {
  Numbers numbers(1);
  Places from, to;
  for (int i = 0; i < 20; ++i) {
    from.push_back(numbers.pointIn(kSize));
    to.push_back((tilted() * from.back().homogeneous()).hnormalized());
  }
  Eigen::Matrix3d map = tilted();
  map(0, 2) += 1.0;
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(fitHomography(from, to, 2.0, map));
  EXPECT_LT(test::cornerError(map, tilted(), kSize), 1e-6);
  const Places one(5, from.front()), its_target(5, to.front());
  EXPECT_FALSE(fitAffine(one, its_target, 2.0, map));
  EXPECT_FALSE(fitHomography(one, its_target, 2.0, map));
}

TEST(GrowthDistance, CountsBits) {
  Bits a{}, b{};
  EXPECT_EQ(distance(a, b), 0);
  b.fill(~std::uint64_t{0});
  EXPECT_EQ(distance(a, b), 256);
  b = {1, 0x8000000000000000U, 0, 0xff};
  EXPECT_EQ(distance(a, b), 10);
}

/// P(Poisson(mean) >= count), summed up.
double logTail(int count, double mean) {
  double sum = 0.0;
  for (int k = count; k < count + 200; ++k) {
    sum += std::exp(k * std::log(mean) - mean - std::lgamma(k + 1.0));
  }
  return std::log10(sum);
}

TEST(GrowthVerdict, BoundsThePoissonTail) {
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

TEST(GrowthRivals, ContradictIfTheyMapTheSameKeypointsElsewhere) {
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
