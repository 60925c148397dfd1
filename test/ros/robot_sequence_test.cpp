// What a frame is matched to where the frames are hard: no ROS master is needed.

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "nodelet/sequence_matcher.h"
#include "robot_testing.h"

namespace ktgp_orb {
namespace {

Configuration keyframeMode(int min_inliers) {
  Configuration configuration;
  configuration.reference.mode = ReferenceMode::keyframe;
  configuration.reference.min_inliers = min_inliers;
  return configuration;
}

/// A view of which only the columns from `begin` to `end` (shares of the width) can be seen.
sensor_msgs::ImagePtr partOfView(double begin, double end, double stamp) {
  static const test::View view({640, 480});
  const sensor_msgs::ImagePtr message = view.image(0, ros::Time(stamp));
  cv::Mat pixels(480, 640, CV_8U, message->data.data());
  pixels.colRange(0, static_cast<int>(begin * 640)).setTo(128);
  pixels.colRange(static_cast<int>(end * 640), 640).setTo(128);
  return message;
}

TEST(Sequence, AWeakKeyframeStaysWhereTheFrameBeforeDoesNotMatch) {
  SequenceMatcher matcher(keyframeMode(1));
  matcher.process(partOfView(0.0, 1.0, 1.0), false);
  const auto left = matcher.process(partOfView(0.0, 0.6, 1.1), false);
  ASSERT_EQ(left.statistics->status, MatchStatistics::STATUS_OK);
  const auto right = matcher.process(partOfView(0.7, 1.0, 1.2), false);
  ASSERT_EQ(right.statistics->status, MatchStatistics::STATUS_OK);
  const auto between = static_cast<int>(left.homography->inliers + right.homography->inliers) / 2;
  ASSERT_LT(right.homography->inliers, left.homography->inliers);

  // The same with a limit that the third frame falls short of: it has nothing in common with the
  // second one, which is tried in its turn, so the keyframe's match must stand.
  matcher = SequenceMatcher(keyframeMode(between));
  matcher.process(partOfView(0.0, 1.0, 1.0), false);
  matcher.process(partOfView(0.0, 0.6, 1.1), false);
  const auto weak = matcher.process(partOfView(0.7, 1.0, 1.2), false);
  EXPECT_EQ(weak.statistics->status, MatchStatistics::STATUS_OK);
  EXPECT_EQ(weak.statistics->reference_stamp, ros::Time(1.0));
  EXPECT_EQ(weak.homography->homography, right.homography->homography);
  ASSERT_TRUE(weak.accumulated_homography);
  EXPECT_EQ(weak.accumulated_homography->reference_stamp, ros::Time(1.0));
  // Both matches took their time.
  double stages = 0.0;
  for (const StageStatistics& stage : weak.statistics->stages) stages += stage.milliseconds;
  EXPECT_GT(weak.statistics->total_milliseconds, weak.statistics->extraction_milliseconds + stages);
}

TEST(Sequence, AMatchAheadCountsOnlyForTheReferenceItNames) {
  const test::View view({320, 240});
  OrbExtractor extractor;
  std::vector<FramePtr> frames;
  for (int i = 0; i < 3; ++i)
    frames.push_back(makeFrame(view.image(i, ros::Time(1 + 0.1 * i)), extractor));
  KtgpMatcher ktgp;
  MatchAhead stale{frames[0], {}};
  ktgp.match(frames[0]->features, frames[2]->features, stale.result);

  SequenceMatcher matcher{Configuration()};
  matcher.process(frames[0], false);
  matcher.process(frames[1], false);
  const auto messages = matcher.process(frames[2], false, &stale);
  EXPECT_EQ(messages.statistics->reference_stamp, ros::Time(1.1));
  EXPECT_NEAR(messages.homography->homography[2], 5.0, 0.5);
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
