// 16-bit grey values as 8-bit ones.
#include "core/util/grey_levels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace ktgp_orb::util {
namespace {

/// A ramp over a thermal camera's few hundred values.
cv::Mat ramp() {
  cv::Mat image(100, 100, CV_16UC1);
  for (int i = 0; i < 10000; ++i) {
    image.at<std::uint16_t>(i / 100, i % 100) = static_cast<std::uint16_t>(30000 + i / 20);
  }
  return image;
}

double mean(const cv::Mat& image) {
  return cv::mean(image)[0];
}

TEST(GreyStretch, HotAndDeadPixelsDoNotDimTheRest) {
  cv::Mat image = ramp();
  const cv::Mat clean = stretchTo8Bit(image);
  image.at<std::uint16_t>(7, 9) = 65535;
  image.at<std::uint16_t>(50, 50) = 0;
  const cv::Mat seen = stretchTo8Bit(image);
  EXPECT_EQ(seen.type(), CV_8UC1);
  EXPECT_EQ(seen.at<uchar>(7, 9), 255);
  EXPECT_EQ(seen.at<uchar>(50, 50), 0);
  double difference = 0.0;
  cv::Mat mask(image.size(), CV_8U, cv::Scalar(255));
  mask.at<uchar>(7, 9) = mask.at<uchar>(50, 50) = 0;
  cv::minMaxLoc(cv::abs(cv::Mat_<short>(clean) - cv::Mat_<short>(seen)), nullptr, &difference,
                nullptr, nullptr, mask);
  EXPECT_LE(difference, 1.0);
  EXPECT_NEAR(mean(seen), 127.5, 1.5) << "the ramp uses all of the range";
}

TEST(GreyStretch, WithoutIgnoredPixelsIsFromTheDarkestToTheBrightest) {
  GreyStretch stretch;
  stretch.percentile = 0.0;
  const cv::Mat seen = stretchTo8Bit(ramp(), stretch);
  for (int i = 0; i < 10000; i += 37) {
    EXPECT_NEAR(seen.at<uchar>(i / 100, i % 100), 255.0 / 499.0 * (i / 20), 0.51);
  }
}

TEST(GreyStretch, IgnoresTheShareThatIsAskedFor) {
  // 10 % at 100, 80 % at 200, 10 % at 300.
  cv::Mat image(10, 100, CV_16UC1, cv::Scalar(200));
  image.row(0).setTo(100);
  image.row(9).setTo(300);
  GreyStretch stretch;
  stretch.percentile = 9.9;
  cv::Mat seen = stretchTo8Bit(image, stretch);
  EXPECT_EQ(seen.at<uchar>(0, 0), 0);
  EXPECT_NEAR(seen.at<uchar>(5, 0), 127.5, 0.51);
  EXPECT_EQ(seen.at<uchar>(9, 0), 255);
  stretch.percentile = 10.1;  // only 200 is left
  seen = stretchTo8Bit(image, stretch);
  EXPECT_EQ(cv::countNonZero(seen), 0);
}

TEST(GreyStretch, FixedEndsAreTheSameForEveryFrame) {
  GreyStretch stretch;
  stretch.kind = GreyStretch::Kind::range;
  stretch.low = 1000;
  stretch.high = 2000;
  for (int other : {0, 65535}) {
    cv::Mat image(2, 2, CV_16UC1, cv::Scalar(other));
    image.at<std::uint16_t>(0, 0) = 1500;
    const cv::Mat seen = stretchTo8Bit(image, stretch);
    EXPECT_NEAR(seen.at<uchar>(0, 0), 127.5, 0.51);
    EXPECT_EQ(seen.at<uchar>(1, 1), other == 0 ? 0 : 255);
  }
}

TEST(GreyStretch, OfAnEvenImageIsDark) {
  for (int value : {0, 7, 65535}) {
    const cv::Mat even(20, 20, CV_16UC1, cv::Scalar(value));
    EXPECT_EQ(cv::countNonZero(stretchTo8Bit(even)), 0) << value;
  }
}

TEST(GreyStretch, RefusesWhatItCannotUse) {
  EXPECT_NO_THROW(requireValid(GreyStretch{}));
  for (double bad : {-0.1, 49.1, std::numeric_limits<double>::quiet_NaN()}) {
    GreyStretch stretch;
    stretch.percentile = bad;
    EXPECT_THROW(requireValid(stretch), std::invalid_argument) << bad;
  }
  for (const auto& [low, high] : {std::pair(-1, 10), {10, 10}, {11, 10}, {0, 65536}}) {
    GreyStretch stretch;
    stretch.low = low;
    stretch.high = high;
    EXPECT_THROW(requireValid(stretch), std::invalid_argument) << low << " " << high;
  }
}

}  // namespace
}  // namespace ktgp_orb::util
