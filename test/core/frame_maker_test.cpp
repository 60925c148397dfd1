// The used part of a camera's images: masks, region of interest, lens, and rate. No ROS master is
// needed.

#include "messages/frame_maker.h"
#include "messages/camera.h"

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>
#include <vector>

#include "messages/image_conversion.h"
#include "messages/message_matcher.h"
#include "messages/rate_limiter.h"
#include "refusal.h"

namespace ktgp_orb {
namespace {

using test::refusalOf;

sensor_msgs::ImageConstPtr image(int width, int height) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->width = message->step = static_cast<std::uint32_t>(width);
  message->height = static_cast<std::uint32_t>(height);
  message->encoding = "mono8";
  message->data.resize(static_cast<std::size_t>(width * height), 7);
  return message;
}

TEST(Roi, IsReadFromFourNumbers) {
  EXPECT_EQ(roiFrom("10 20 30 40"), cv::Rect(10, 20, 30, 40));
  EXPECT_EQ(roiFrom(" 10, 20,30 ,40 "), cv::Rect(10, 20, 30, 40));
  EXPECT_TRUE(roiFrom("").empty());
  EXPECT_TRUE(roiFrom("  ").empty());
}

TEST(Roi, RefusesAnythingElse) {
  for (const char* text : {"10 20 30", "10 20 30 40 50", "a b c d", "-1 0 10 10", "0 0 0 10",
                           "0 0 10 -1", "0.5 0 10 10", "0 0 10 10px", "nan nan nan nan"}) {
    const std::string error = refusalOf([&] { roiFrom(text); });
    EXPECT_NE(error.find("roi is '" + std::string(text) + "'; expected x y width height"),
              std::string::npos)
        << text << ": " << error;
  }
}

TEST(FrameMaker, APixelCountsWhereAllSaySo) {
  CameraView view;
  view.roi = {10, 10, 100, 20};  // beyond the right edge
  view.file_mask = cv::Mat::zeros(40, 60, CV_8UC1);
  view.file_mask(cv::Rect(0, 0, 30, 40)).setTo(1);
  view.sent_mask = cv::Mat(40, 60, CV_8UC1, cv::Scalar(200));
  view.sent_mask(cv::Rect(12, 12, 4, 4)).setTo(0);
  FrameMaker maker({}, view);
  Frame frame;
  maker.make(image(60, 40), frame);
  cv::Mat expected = cv::Mat::zeros(40, 60, CV_8UC1);
  expected(cv::Rect(10, 10, 20, 20)).setTo(255);
  expected(cv::Rect(12, 12, 4, 4)).setTo(0);
  ASSERT_EQ(frame.mask.size(), expected.size());
  EXPECT_EQ(cv::countNonZero(frame.mask != expected), 0);
  const cv::Mat first = frame.mask;
  maker.make(image(60, 40), frame);
  EXPECT_EQ(frame.mask.data, first.data) << "made once";
}

TEST(FrameMaker, WithoutAnyThereIsNoMask) {
  FrameMaker maker({}, {});
  Frame frame;
  maker.make(image(60, 40), frame);
  EXPECT_TRUE(frame.mask.empty());
  EXPECT_EQ(frame.image.size(), cv::Size(60, 40));
}

TEST(FrameMaker, RefusesAMaskOfAnotherSizeAndARoiOutside) {
  CameraView view;
  view.file_mask = cv::Mat(40, 61, CV_8UC1, cv::Scalar(1));
  Frame frame;
  const auto refusal = [&] {
    return refusalOf<RefusedImage>([&] { FrameMaker({}, view).make(image(60, 40), frame); });
  };
  EXPECT_EQ(refusal(), "mask_image is 61x40; expected 60x40 like the image");
  view.file_mask.release();
  view.sent_mask = cv::Mat(41, 60, CV_8UC1, cv::Scalar(1));
  EXPECT_EQ(refusal(), "the image on ~mask is 60x41; expected 60x40 like the image");
  view.sent_mask.release();
  view.roi = {60, 0, 10, 10};
  EXPECT_EQ(refusal(), "roi is outside of the image of 60x40");
}

TEST(FrameMaker, AnEmptyMessageIsNoMask) {
  EXPECT_TRUE(maskFrom(image(0, 0)).empty());
  EXPECT_EQ(maskFrom(image(8, 4)).size(), cv::Size(8, 4));
}

sensor_msgs::CameraInfo calibrated() {
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.distortion_model = "plumb_bob";
  info.D = {-0.2, 0.05, 0.0, 0.0, 0.0};
  info.K = {500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {450.0, 0.0, 322.0, 0.0, 0.0, 460.0, 242.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

TEST(MatcherOverlay, HasTheColoursOfTheCamera) {
  cv::Mat grey(240, 320, CV_8UC1);
  cv::RNG(1).fill(grey, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(grey, grey, {}, 2.0);
  const cv::Mat dark = 0.2 * grey;
  cv::Mat red;
  cv::merge(std::vector<cv::Mat>{dark, dark, grey}, red);
  for (const OverlayStyle style : {OverlayStyle::flow, OverlayStyle::side_by_side}) {
    Configuration configuration = configurationFrom(Parameters(), 0);
    configuration.overlay_style = style;
    MessageMatcher matcher(configuration);
    for (int i = 0; i < 2; ++i) {
      const sensor_msgs::ImagePtr message = toImage({}, "bgr8", red);
      message->header.stamp = ros::Time(1 + i);
      message->header.frame_id = "camera";
      matcher.process(message);
      const sensor_msgs::ImageConstPtr overlay = matcher.overlay(message);
      EXPECT_EQ(overlay->header.stamp, message->header.stamp);
      EXPECT_EQ(overlay->header.frame_id, "camera");
      const cv::Mat picture = cv_bridge::toCvShare(overlay)->image;
      const cv::Scalar mean =
          cv::mean(picture(cv::Rect(picture.cols - 40, picture.rows - 40, 40, 40)));
      EXPECT_GT(mean[2], mean[0] + 10.0) << toString(style) << i;
    }
  }
  MessageMatcher matcher(configurationFrom(Parameters(), 0));
  cv::Mat deep;
  red.convertTo(deep, CV_16U, 16.0);
  const sensor_msgs::ImageConstPtr message = toImage({}, "bgr16", deep);
  matcher.process(message);
  EXPECT_GT(cv::mean(cv_bridge::toCvShare(matcher.overlay(message))->image)[0], 40.0)
      << "12 bits are stretched";
}

// Other options find its features anew, in another frame of the same image.
TEST(MessageMatcher, AConfiguredReferenceStaysOneWithOtherOptions) {
  cv::Mat grey(240, 320, CV_8UC1);
  cv::RNG(1).fill(grey, cv::RNG::UNIFORM, 0, 256);
  const sensor_msgs::ImagePtr seen = toImage({}, "mono8", grey);
  Parameters parameters;
  parameters.reference_mode = "fixed";
  Configuration configuration = configurationFrom(parameters, 0);
  configuration.reference_image = seen;
  MessageMatcher matcher(configuration);
  for (const int features : {500, 1000}) {
    parameters.features = features;
    configuration.sequence = configurationFrom(parameters, 0).sequence;
    matcher.configure(configuration);
    matcher.process(seen);
    EXPECT_FALSE(matcher.holdsSetReference()) << features;
  }
  matcher.fixNextFrame();
  matcher.process(toImage({}, "mono8", grey));
  EXPECT_TRUE(matcher.holdsSetReference());
}

TEST(Lens, IsThatOfTheCameraInfo) {
  const LensCalibration c = lensFrom(calibrated())->calibration();
  EXPECT_EQ(c.image_size, cv::Size(640, 480));
  EXPECT_EQ(c.camera(1, 1), 510.0);
  EXPECT_EQ(c.rectified_camera(0, 2), 322.0);
  EXPECT_EQ(c.distortion.size(), 5U);
}

TEST(Lens, OfASecondCameraIsTurnedAsRectificationSays) {
  sensor_msgs::CameraInfo info = calibrated();
  const double angle = 0.05;
  info.R = {std::cos(angle),  0.0, std::sin(angle), 0.0, 1.0, 0.0,
            -std::sin(angle), 0.0, std::cos(angle)};
  const LensCalibration turned = lensFrom(info)->calibration();
  EXPECT_EQ(turned.rotation, cv::Matx33d(info.R.data()));
  info.R.fill(0.0);  // of a camera_info without rotation
  EXPECT_EQ(lensFrom(info)->calibration().rotation, cv::Matx33d::eye());
}

// A 400x300 part of the sensor, read out at half size: the centre (320, 240) of the sensor is
// at ((320 - 100) / 2, (240 - 60) / 2) of the image.
TEST(Lens, KnowsBinningAndThePartOfTheSensor) {
  sensor_msgs::CameraInfo info = calibrated();
  info.binning_x = info.binning_y = 2;
  info.roi.x_offset = 100;
  info.roi.y_offset = 60;
  info.roi.width = 400;
  info.roi.height = 300;
  const LensCalibration c = lensFrom(info)->calibration();
  EXPECT_EQ(c.image_size, cv::Size(200, 150));
  EXPECT_EQ(c.camera(0, 0), 250.0);
  EXPECT_EQ(c.camera(1, 1), 255.0);
  EXPECT_EQ(c.camera(0, 2), 110.0);
  EXPECT_EQ(c.camera(1, 2), 90.0);
  EXPECT_EQ(c.rectified_camera(0, 2), 111.0);
}

TEST(Lens, OfAnUncalibratedCameraIsRefused) {
  EXPECT_NE(refusalOf([] { lensFrom(sensor_msgs::CameraInfo()); }).find("not calibrated"),
            std::string::npos);
  sensor_msgs::CameraInfo info = calibrated();
  info.distortion_model = "mei";
  EXPECT_NE(refusalOf([&] { lensFrom(info); }).find("'mei'; expected"), std::string::npos);
}

TEST(Lens, WhatNoCameraHasIsRefused) {
  using Change = std::function<void(sensor_msgs::CameraInfo&)>;
  const std::vector<std::pair<std::string, Change>> changes{
      {"camera matrix has skew, 40.0", [](auto& i) { i.K[1] = 40.0; }},
      {"rectified camera matrix has skew, 40.0", [](auto& i) { i.P[1] = 40.0; }},
      {"the camera matrix is not upper triangular", [](auto& i) { i.K[6] = 0.1; }},
      {"the rectifying rotation is no rotation matrix", [](auto& i) { i.R[8] = -1.0; }},
      {"the rectifying rotation is no rotation matrix", [](auto& i) { i.R[1] = 0.1; }},
      {"fx of the camera matrix is 1e-10; expected", [](auto& i) { i.K[0] = 1e-10; }},
      {"fx of the camera matrix is 1e+300; expected", [](auto& i) { i.K[0] = 1e300; }},
      {"fy of the rectified camera matrix is 1e+12", [](auto& i) { i.P[5] = 1e12; }},
      {"cx of the camera matrix is 1e+07; expected", [](auto& i) { i.K[2] = 1e7; }}};
  for (const auto& [words, change] : changes) {
    sensor_msgs::CameraInfo info = calibrated();
    change(info);
    const std::string error = refusalOf([&] { lensFrom(info); });
    EXPECT_NE(error.find(words), std::string::npos) << words << ": " << error;
  }
}

TEST(Lens, OfAnotherImageSizeIsNotUsed) {
  CameraView view;
  view.lens = lensFrom(calibrated());
  FrameMaker maker({}, view);
  Frame frame;
  maker.make(image(640, 480), frame);
  EXPECT_EQ(frame.lens, view.lens);
  maker.make(image(320, 240), frame);
  EXPECT_EQ(frame.lens, nullptr);
}

/// Numbers of the frames of `rate` Hz that are used of the first `count`; each stamp is off by up
/// to `shake` of the time between two frames.
std::vector<int> taken(double rate, double max_rate, int count, double shake = 0.0) {
  RateLimiter limiter;
  limiter.setRate(max_rate);
  std::vector<int> numbers;
  std::srand(1);
  for (int i = 0; i < count; ++i) {
    const double off = shake * (2.0 * std::rand() / RAND_MAX - 1.0);
    if (limiter.takes(ros::Time(1000.0 + (i + off) / rate))) numbers.push_back(i);
  }
  return numbers;
}

TEST(RateLimiter, SkipsEvenly) {
  const std::vector<std::pair<double, double>> cases{
      {30.0, 20.0}, {60.0, 7.0}, {30.0, 29.0}, {25.0, 0.5}};
  for (const auto& [rate, limit] : cases) {
    const std::vector<int> numbers = taken(rate, limit, 3000);
    EXPECT_NEAR(double(numbers.size()), 3000.0 * limit / rate, 1.5) << rate << " " << limit;
    const int step = static_cast<int>(rate / limit);
    for (std::size_t i = 2; i < numbers.size(); ++i) {  // the first slot is half a slot
      const int gap = numbers[i] - numbers[i - 1];
      EXPECT_TRUE(gap == step || gap == step + 1) << rate << " to " << limit << ": " << gap;
    }
  }
}

TEST(RateLimiter, ACameraAsFastAsTheLimitLosesNothingThoughItsStampsShake) {
  EXPECT_EQ(taken(30.0, 30.0, 3000, 0.2).size(), 3000U);
  EXPECT_EQ(taken(10.0, 30.0, 300, 0.4).size(), 300U);
}

TEST(RateLimiter, ZeroTakesAllAndAStampThatGoesBackBeginsAnew) {
  EXPECT_EQ(taken(1000.0, 0.0, 500).size(), 500U);
  RateLimiter limiter;
  limiter.setRate(1.0);
  EXPECT_TRUE(limiter.takes(ros::Time(100.0)));
  EXPECT_FALSE(limiter.takes(ros::Time(100.1)));
  EXPECT_TRUE(limiter.takes(ros::Time(50.0)));
  EXPECT_FALSE(limiter.takes(ros::Time(50.1)));
  limiter.setRate(2.0);
  EXPECT_TRUE(limiter.takes(ros::Time(50.2)));
}

}  // namespace
}  // namespace ktgp_orb
