// Compares the truth in the demo bag with the pictures: direct alignment of the grey values.

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "demo/effects.h"
#include "demo/flight.h"
#include "demo/map.h"

namespace ktgp_orb::demo {
namespace {

constexpr int kFrames = 300;

cv::Mat greyPicture(const cv::Mat& map, int frame) {
  cv::Mat grey;
  cv::cvtColor(takePicture(map, frame, kFrames, 1), grey, cv::COLOR_BGR2GRAY);
  return grey;
}

cv::Mat truth(int frame) {
  const Eigen::Matrix3d h =
      imageFromMap(frame / kFrameRate) * imageFromMap((frame - 1) / kFrameRate).inverse();
  cv::Mat out;
  cv::eigen2cv(Eigen::Matrix3d(h / h(2, 2)), out);
  return out;
}

std::vector<cv::Point2d> mappedCorners(const cv::Mat& homography) {
  const std::vector<cv::Point2d> corners{{0, 0}, {639, 0}, {639, 479}, {0, 479}};
  std::vector<cv::Point2d> mapped;
  cv::perspectiveTransform(corners, mapped, homography);
  return mapped;
}

TEST(DemoTruth, MatchesAlignedPicturesWithinATenthOfAPixel) {
  const cv::Mat map = drawMap(1);
  for (int frame : {1, 40, 80, 120, 149}) {
    ASSERT_EQ(segmentOf(frame, kFrames), Segment::clean);
    const cv::Mat before = greyPicture(map, frame - 1);
    const cv::Mat now = greyPicture(map, frame);
    cv::Mat aligned;
    truth(frame).convertTo(aligned, CV_32F);
    // findTransformECC maps template to input pixels: the direction of our homography.
    cv::findTransformECC(before, now, aligned, cv::MOTION_HOMOGRAPHY,
                         {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 30, 1e-7});
    aligned.convertTo(aligned, CV_64F);
    const auto expected = mappedCorners(truth(frame));
    const auto found = mappedCorners(aligned);
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_LT(cv::norm(found[i] - expected[i]), 0.1) << "corner " << i << " of frame " << frame;
    }
  }
}

TEST(DemoTruth, MotionBetweenFramesIsThatOfAHandheldOrFlyingCamera) {
  for (int frame = 1; frame < kFrames; ++frame) {
    const auto moved = mappedCorners(truth(frame));
    EXPECT_LT(cv::norm(moved[0] - cv::Point2d(0, 0)), 30.0);
    EXPECT_GT(cv::norm(moved[0] - cv::Point2d(0, 0)) + cv::norm(moved[2] - cv::Point2d(639, 479)),
              1.0);
  }
}

TEST(DemoMap, SameSeedSameMap) {
  const cv::Mat first = drawMap(3);
  EXPECT_EQ(cv::norm(first, drawMap(3), cv::NORM_INF), 0.0);
  EXPECT_GT(cv::norm(first, drawMap(4), cv::NORM_INF), 0.0);
}

}  // namespace
}  // namespace ktgp_orb::demo
