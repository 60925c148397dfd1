// The matcher with the geometry that fits: drawn scenes with exact truth, and real ones.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "frame_pair.h"
#include "ktgp_orb/sequence_matcher.h"
#include "orb_test_images.h"

namespace ktgp_orb {
namespace {

using test::FramePair;

const cv::Size kSize(640, 480);

Eigen::Matrix3d camera() {
  Eigen::Matrix3d k;
  k << 520.0, 0.0, 319.5, 0.0, 520.0, 239.5, 0.0, 0.0, 1.0;
  return k;
}

cv::Mat texture(int seed) {
  return test::textureImage(kSize, static_cast<std::uint64_t>(seed));
}

RelativePose motion() {
  RelativePose pose;
  pose.rotation =
      Eigen::AngleAxisd(0.03, Eigen::Vector3d(0.2, 1.0, 0.3).normalized()).toRotationMatrix();
  pose.translation = Eigen::Vector3d(-0.9, 0.1, 0.3).normalized();
  return pose;
}

/// The image after the motion over a distance of 0.3: the left half of the reference is `near`
/// away, the right half `far`.
cv::Mat seenFrom(const cv::Mat& reference, const RelativePose& pose, double near, double far) {
  constexpr double kDistance = 0.3;
  cv::Mat target(kSize, CV_8UC1, cv::Scalar(128));
  for (const double depth : {far, near}) {  // what is near hides what is far
    const Eigen::Matrix3d h =
        camera() *
        (pose.rotation + kDistance / depth * pose.translation * Eigen::RowVector3d(0.0, 0.0, 1.0)) *
        camera().inverse();
    const cv::Rect half(depth == near ? 0 : kSize.width / 2, 0, kSize.width / 2, kSize.height);
    cv::Mat part = cv::Mat::zeros(kSize, CV_8UC1);
    part(near == far ? cv::Rect({}, kSize) : half).setTo(255);
    const cv::Mat mask = test::warped(part, h, kSize, cv::INTER_NEAREST);
    test::warped(reference, h, kSize).copyTo(target, mask);
  }
  return target;
}

MatchHints withCamera() {
  MatchHints hints;
  hints.reference_camera = camera();
  return hints;
}

MatchResult matched(const FramePair& frames, const MatchHints& hints,
                    const MatcherOptions& options = MatcherOptions::slam()) {
  return test::matched(frames, options, hints);
}

/// `seed`: of the reference.
FramePair framesOf(int seed, const RelativePose& pose, double near, double far) {
  const cv::Mat reference = texture(seed);
  return {reference, seenFrom(reference, pose, near, far)};
}

double turnError(const RelativePose& a, const RelativePose& b) {
  return Eigen::AngleAxisd(a.rotation * b.rotation.transpose()).angle();
}

double directionError(const RelativePose& a, const RelativePose& b) {
  return std::acos(std::min(1.0, a.translation.dot(b.translation)));
}

TEST(TwoViewOfMatcher, FindsTheMotionOverASceneWithDepth) {
  const FramePair frames = framesOf(1, motion(), 2.0, 6.0);
  MatchResult result = matched(frames, withCamera());
  ASSERT_EQ(result.geometry, Geometry::epipolar);
  EXPECT_EQ(result.found(), Status::ok);
  // Who knows only homographies is not misled.
  EXPECT_EQ(result.status, Status::model_rejected);
  EXPECT_TRUE(result.answer.homography.isZero(0.0));
  EXPECT_TRUE(result.guided.empty());
  const TwoView& view = result.two_view.view;
  EXPECT_LT(turnError(view.pose, motion()), 0.002);
  EXPECT_LT(directionError(view.pose, motion()), 0.02);
  EXPECT_TRUE(view.pose_covariance.allFinite());
  EXPECT_GT(view.parallax, 1.0);
  EXPECT_LT(view.log_false_alarms_epipolar, view.log_false_alarms_homography);
  std::size_t inliers = 0;
  for (std::size_t i = 0; i < result.correspondences.size(); ++i) {
    EXPECT_EQ(result.correspondences[i].level, result.two_view.levels[i]);
    inliers += result.correspondences[i].level == Level::ktgp;
  }
  EXPECT_EQ(inliers, result.inliers);
  EXPECT_EQ(result.stage("two_view")->output, result.inliers);
  EXPECT_GT(inliers, 300u);

  result = matched(frames, MatchHints());  // without K
  ASSERT_EQ(result.geometry, Geometry::epipolar);
  EXPECT_TRUE(result.two_view.view.pose.translation.isZero(0.0));
  EXPECT_NEAR(result.two_view.view.fundamental.norm(), 1.0, 1e-9);
}

TEST(TwoViewOfMatcher, APlaneHasTheHomographyAndTheMotion) {
  const FramePair frames = framesOf(2, motion(), 2.0, 2.0);
  const MatchResult result = matched(frames, withCamera());
  ASSERT_EQ(result.geometry, Geometry::plane);
  EXPECT_EQ(result.status, Status::ok);
  EXPECT_EQ(result.found_by, FoundBy::prosac);
  EXPECT_EQ(result.alignment.status, AlignmentStatus::ok);
  const TwoView& view = result.two_view.view;
  const bool first = directionError(view.pose, motion()) < 0.05;
  EXPECT_TRUE(first || (view.other_pose && directionError(*view.other_pose, motion()) < 0.05));
  for (const Correspondence& c : result.correspondences) EXPECT_LE(c.level, Level::ktgp);
}

TEST(TwoViewOfMatcher, ATurnIsARotationWithK) {
  RelativePose turn = motion();
  turn.translation.setZero();
  const FramePair frames = framesOf(3, turn, 2.0, 6.0);
  const MatchResult result = matched(frames, withCamera());
  ASSERT_EQ(result.geometry, Geometry::rotation);
  EXPECT_EQ(result.status, Status::ok);
  EXPECT_LT(turnError(result.two_view.view.pose, turn), 0.002);
}

TEST(TwoViewOfMatcher, EpipolarLooksForNoHomography) {
  const FramePair depth = framesOf(4, motion(), 2.0, 6.0);
  MatcherOptions options = MatcherOptions::slam();
  options.geometry = GeometryModel::epipolar;
  const MatchResult result = matched(depth, withCamera(), options);
  EXPECT_EQ(result.geometry, Geometry::epipolar);
  EXPECT_EQ(result.two_view.view.log_false_alarms_homography, 0.0);
  EXPECT_EQ(result.stages[3].output, 0u);
  EXPECT_STREQ(result.stages[3].name, "prosac");
}

TEST(TwoViewOfMatcher, TheDefaultHasNoSuchStage) {
  const FramePair frames = framesOf(5, motion(), 2.0, 2.0);
  const MatchResult result = matched(frames, withCamera(), {});  // K is not used
  EXPECT_EQ(result.stage("two_view"), nullptr);
  EXPECT_EQ(result.geometry, Geometry::plane);
  EXPECT_EQ(result.two_view.view.geometry, Geometry::plane);
  EXPECT_TRUE(result.two_view.pairs.reference.empty());
}

TEST(TwoViewOfMatcher, NothingInCommonGivesNone) {
  const FramePair frames(texture(6), texture(7));
  const MatchResult result = matched(frames, withCamera());
  EXPECT_EQ(result.geometry, Geometry::none);
  EXPECT_NE(result.found(), Status::ok);
  EXPECT_EQ(result.inliers, 0u);
  EXPECT_EQ(result.two_view.view.geometry, Geometry::none);
  const FramePair empty(texture(6), cv::Mat::zeros(kSize, CV_8UC1));
  EXPECT_EQ(matched(empty, withCamera()).status, Status::too_few_features);
}

TEST(TwoViewOfMatcher, RefusesAKOfAnotherImage) {
  const FramePair frames(texture(8), texture(8));
  MatchHints hints = withCamera();
  (*hints.reference_camera)(0, 2) = 900.0;
  EXPECT_THROW(matched(frames, hints), std::invalid_argument);
  hints = withCamera();
  (*hints.reference_camera)(1, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(matched(frames, hints), std::invalid_argument);
}

/// A raw image, whose points are moved by the lens, gives the motion, too.
TEST(TwoViewOfMatcher, ALensMovesThePoints) {
  LensCalibration calibration;
  calibration.image_size = kSize;
  cv::eigen2cv(camera(), calibration.camera);
  calibration.rectified_camera = calibration.camera;
  calibration.distortion = {-0.12, 0.03, 0.0, 0.0};
  const Lens lens(calibration);
  // The raw image shows at x what the image without distortion shows at rectify(x).
  const auto distorted = [&](const cv::Mat& straight) {
    std::vector<cv::KeyPoint> points;
    for (int y = 0; y < kSize.height; ++y) {
      for (int x = 0; x < kSize.width; ++x) points.emplace_back(float(x), float(y), 1.F);
    }
    lens.rectify(points);
    cv::Mat map(kSize, CV_32FC2);
    for (int i = 0; i < int(points.size()); ++i) {
      map.at<cv::Vec2f>(i / kSize.width, i % kSize.width) = {points[std::size_t(i)].pt.x,
                                                             points[std::size_t(i)].pt.y};
    }
    cv::Mat raw;
    cv::remap(straight, raw, map, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
    return raw;
  };
  const cv::Mat reference = texture(9);
  const cv::Mat target = seenFrom(reference, motion(), 2.0, 6.0);
  MatchHints hints = withCamera();
  const auto expect_motion = [&](const FramePair& frames) {
    const MatchResult result = matched(frames, hints);
    ASSERT_EQ(result.geometry, Geometry::epipolar);
    EXPECT_LT(turnError(result.two_view.view.pose, motion()), 0.003);
    EXPECT_LT(directionError(result.two_view.view.pose, motion()), 0.03);
  };
  hints.target_lens = &lens;
  expect_motion({reference, distorted(target)});  // each image has its own lens
  hints.reference_lens = &lens;
  expect_motion({distorted(reference), distorted(target)});
}

TEST(TwoViewOfMatcher, ASequenceKnowsItsCamera) {
  SequenceOptions options;
  options.matcher = MatcherOptions::slam();
  SequenceMatcher sequence(options);
  const cv::Mat reference = texture(10);
  const cv::Mat images[] = {reference, seenFrom(reference, motion(), 2.0, 6.0)};
  for (int i = 0; i < 2; ++i) {
    const FramePtr frame = sequence.newFrame();
    frame->stamp = i * 100000000;
    frame->image = images[i];
    frame->camera = camera();
    const SequenceMatch& match = sequence.match(frame);
    if (i == 0) continue;
    ASSERT_EQ(match.match.geometry, Geometry::epipolar);
    EXPECT_LT(directionError(match.match.two_view.view.pose, motion()), 0.02);
    EXPECT_FALSE(match.accumulated);
  }
  // A frame of the pool does not remember the camera of the frame that it was.
  for (int i = 2; i < 12; ++i) {
    const FramePtr frame = sequence.newFrame();
    EXPECT_FALSE(frame->camera) << i;
    frame->stamp = i * 100000000;
    frame->image = images[i % 2];
    const SequenceMatch& match = sequence.match(frame);
    EXPECT_EQ(match.match.geometry, Geometry::epipolar);
    EXPECT_TRUE(match.match.two_view.view.pose.translation.isZero(0.0));
  }
}

}  // namespace
}  // namespace ktgp_orb
