// The optional stages after the four, and those of the robust preset.
#include "ktgp_orb/ktgp_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "alignment_scene.h"
#include "frame_pair.h"
#include "ktgp_orb/evaluation.h"
#include "orb_test_images.h"

namespace ktgp_orb {
namespace {

using test::matched;

struct Pair : test::FramePair {
  Eigen::Matrix3d truth;
};

Pair warpedPair(const Eigen::Matrix3d& truth) {
  cv::Mat image;
  cv::GaussianBlur(test::textureImage(cv::Size(640, 480), 1), image, cv::Size(), 1.0);
  return {{image, test::warped(image, truth, image.size())}, truth};
}

double errorOf(const Eigen::Matrix3d& homography, const Pair& pair) {
  return evaluation::cornerError(homography, pair.truth, pair.reference.image_size);
}

/// Over the inliers and the guided matches, by the final homography.
double rmseOf(const MatchResult& result, const Pair& pair) {
  std::vector<Correspondence> matches;
  result.surviving(Level::ktgp, matches);
  matches.insert(matches.end(), result.guided.begin(), result.guided.end());
  return evaluation::summarize(evaluation::reprojectionErrors(result.answer.homography,
                                                              pair.reference, pair.target, matches))
      .rms;
}

TEST(MatcherRefinement, AlignmentCorrectsTheHomographyAndLeavesTheFourStagesAlone) {
  const Pair pair = warpedPair(test::turn(4.0, 1.03));
  MatcherOptions without;
  without.alignment.enabled = false;
  const MatchResult plain = matched(pair, without);
  const MatchResult aligned = matched(pair, {});
  ASSERT_EQ(plain.status, Status::ok);
  ASSERT_EQ(aligned.status, Status::ok);
  EXPECT_EQ(plain.answer.homography, plain.prosac.answer.homography);
  EXPECT_EQ(aligned.prosac.answer.homography, plain.prosac.answer.homography);
  EXPECT_EQ(aligned.answer.homography, aligned.alignment.answer.homography);
  EXPECT_EQ(aligned.alignment.status, AlignmentStatus::ok);
  EXPECT_LT(errorOf(aligned.answer.homography, pair), 0.05);
  EXPECT_LT(errorOf(aligned.answer.homography, pair), 0.5 * errorOf(plain.answer.homography, pair));
  EXPECT_LT(aligned.alignment.rmse_after, aligned.alignment.rmse_before);
  EXPECT_NEAR(plain.rmse, plain.prosac.rmse, 1e-9);
  EXPECT_NEAR(aligned.rmse, rmseOf(aligned, pair), 1e-9);
  for (std::size_t i = 0; i < plain.stages.size(); ++i) {
    EXPECT_EQ(aligned.stages[i].output, plain.stages[i].output);
  }
  for (std::size_t i = 0; i < plain.correspondences.size(); ++i) {
    const Level before = plain.correspondences[i].level;
    const Level after = aligned.correspondences[i].level;
    EXPECT_EQ(std::min(after, Level::ktg), std::min(before, Level::ktg))
        << "the first three stages";
  }
  EXPECT_EQ(plain.stage("align"), nullptr);
  ASSERT_NE(aligned.stage("align"), nullptr);
  EXPECT_EQ(aligned.stage("align")->input, aligned.stages[3].output);
  EXPECT_EQ(aligned.stage("align")->output, aligned.alignment.points.size());
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
  EXPECT_EQ(result.stage("guided")->output, result.inliers);
  std::vector<bool> final_already(pair.target.size());
  for (const Correspondence& c : result.correspondences) {
    final_already[static_cast<std::size_t>(c.target_index)] = c.level >= Level::ktgp;
  }
  for (const Correspondence& c : result.guided) {
    EXPECT_EQ(c.level, Level::guided);
    EXPECT_FALSE(final_already[static_cast<std::size_t>(c.target_index)]);
  }
  for (const double error : evaluation::reprojectionErrors(result.answer.homography, pair.reference,
                                                           pair.target, result.guided)) {
    EXPECT_LT(error, options.prosac.max_error);
  }
  EXPECT_NEAR(result.rmse, rmseOf(result, pair), 1e-9);
}

TEST(MatcherRefinement, TheRobustPresetFindsWhatTheMotionStatisticsLose) {
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

}  // namespace
}  // namespace ktgp_orb
