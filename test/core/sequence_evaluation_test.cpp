#include "evaluation/sequence_evaluation.h"

#include <gtest/gtest.h>

#include "orb_test_images.h"

namespace ktgp_orb::tools {
namespace {

constexpr int kWidth = 320;
constexpr int kHeight = 240;

/// The camera's view after `i` steps of (3, 2) px.
cv::Mat view(const cv::Mat& world, int i) {
  return world(cv::Rect(3 * i, 2 * i, kWidth, kHeight)).clone();
}

Eigen::Matrix3d step() {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  h(0, 2) = -3.0;
  h(1, 2) = -2.0;
  return h;
}

TEST(Sequence, FollowsASteadyCamera) {
  const cv::Mat map = test::blockImage({800, 600}, 3, 120);
  SequenceEvaluator evaluator({}, {}, 5);
  for (int i = 0; i < 12; ++i) evaluator.addFrame(100.0 + 0.1 * i, view(map, i), step());
  const SequenceScore score = evaluator.score();
  ASSERT_EQ(score.frames.size(), 12u);
  EXPECT_EQ(score.frames[0].status, Status::no_reference);
  EXPECT_FALSE(score.frames[0].drift.has_value());
  for (std::size_t i = 1; i < 12; ++i) {
    const FrameScore& f = score.frames[i];
    EXPECT_NEAR(f.time, 0.1 * static_cast<double>(i), 1e-9);
    EXPECT_EQ(f.status, Status::ok);
    EXPECT_GT(f.inlier_ratio, 0.8);
    EXPECT_EQ(f.keypoints, f.matches[0]);
    EXPECT_LT(f.corner_error.value_or(99.0), 1.5);
    EXPECT_LT(f.drift.value_or(99.0), 4.0);
  }
  // A window of five frames begins at frames 1, 6 and 11.
  for (std::size_t i : {1, 6, 11}) {
    EXPECT_NEAR(*score.frames[i].drift, *score.frames[i].corner_error, 1e-9);
  }
  ASSERT_EQ(score.survival.size(), 11u);
  EXPECT_DOUBLE_EQ(score.survival[0], 1.0);
  for (std::size_t k = 1; k < 11; ++k) {
    EXPECT_LE(score.survival[k], score.survival[k - 1] + 0.05);
    EXPECT_GT(score.survival[k], 0.02);
  }
}

TEST(Sequence, TracksAndDriftEndAtAFrameThatShowsNothing) {
  const cv::Mat map = test::blockImage({800, 600}, 3, 120);
  SequenceEvaluator evaluator({}, {}, 0);
  for (int i = 0; i < 7; ++i) {
    const bool blank = i == 3;
    evaluator.addFrame(i, blank ? cv::Mat(kHeight, kWidth, CV_8U, cv::Scalar(0)) : view(map, i),
                       step());
  }
  const SequenceScore score = evaluator.score();
  EXPECT_EQ(score.frames[3].status, Status::too_few_features);
  EXPECT_EQ(score.frames[4].status, Status::too_few_features);
  EXPECT_FALSE(score.frames[3].drift.has_value());
  EXPECT_NEAR(*score.frames[5].drift, *score.frames[5].corner_error, 1e-9) << "it restarts";
  EXPECT_GT(score.survival[1], 0.0);
  EXPECT_EQ(score.survival[2], 0.0) << "no track can be longer than two matches";
}

TEST(Sequence, WithoutTruthThereIsNoDrift) {
  const cv::Mat map = test::blockImage({800, 600}, 3, 120);
  SequenceEvaluator evaluator({}, {}, 30);
  for (int i = 0; i < 3; ++i) evaluator.addFrame(i, view(map, i), std::nullopt);
  const SequenceScore score = evaluator.score();
  EXPECT_EQ(score.frames[2].status, Status::ok);
  EXPECT_FALSE(score.frames[2].corner_error.has_value());
  EXPECT_FALSE(score.frames[2].drift.has_value());
  EXPECT_EQ(toJson(score)["frames"].size(), 3u);
}

TEST(Sequence, OfNoFramesAndOfOne) {
  SequenceEvaluator evaluator({}, {}, 30);
  EXPECT_TRUE(evaluator.score().frames.empty());
  EXPECT_TRUE(evaluator.score().survival.empty());
  evaluator.addFrame(0.0, view(test::blockImage({800, 600}, 3, 120), 0), std::nullopt);
  EXPECT_EQ(evaluator.score().frames.size(), 1u);
  EXPECT_TRUE(evaluator.score().survival.empty());
}

}  // namespace
}  // namespace ktgp_orb::tools
