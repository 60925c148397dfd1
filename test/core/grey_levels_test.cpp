// 16-bit grey values as 8-bit ones.
#include "core/util/grey_levels.h"

#include <gtest/gtest.h>

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

TEST(GreyStretch, IgnoresATenthOfAPercentAtEachEnd) {
  // Of 10000 pixels `outliers` at 100 and at 300, and 1 % at 220; the others are 200.
  for (const int outliers : {9, 11}) {
    cv::Mat image(100, 100, CV_16UC1, cv::Scalar(200));
    image.row(50).setTo(220);
    image(cv::Rect(0, 0, outliers, 1)).setTo(100);
    image(cv::Rect(0, 99, outliers, 1)).setTo(300);
    const cv::Mat seen = stretchTo8Bit(image);
    EXPECT_NEAR(seen.at<uchar>(20, 0), outliers < 10 ? 0.0 : 127.5, 0.51);
    EXPECT_NEAR(seen.at<uchar>(50, 0), outliers < 10 ? 255.0 : 153.0, 0.51);
    EXPECT_EQ(seen.at<uchar>(0, 0), 0);
    EXPECT_EQ(seen.at<uchar>(99, 0), 255);
  }
}

TEST(GreyStretch, OfTheWholeRangeIsTheSameForEveryFrame) {
  for (int other : {0, 65535}) {
    cv::Mat image(2, 2, CV_16UC1, cv::Scalar(other));
    image.at<std::uint16_t>(0, 0) = 12850;
    const cv::Mat seen = stretchTo8Bit(image, GreyStretch::range);
    EXPECT_EQ(seen.at<uchar>(0, 0), 50);
    EXPECT_EQ(seen.at<uchar>(1, 1), other == 0 ? 0 : 255);
  }
}

TEST(GreyStretch, OfAnEvenImageIsDark) {
  for (int value : {0, 7, 65535}) {
    const cv::Mat even(20, 20, CV_16UC1, cv::Scalar(value));
    EXPECT_EQ(cv::countNonZero(stretchTo8Bit(even)), 0) << value;
  }
}

}  // namespace
}  // namespace ktgp_orb::util
