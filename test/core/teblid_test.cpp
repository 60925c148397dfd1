// TEBLID against the descriptors of its authors' program, and its vector code against the plain
// definition.
#include "core/orb/teblid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "core/orb/teblid_table.h"
#include "orb_test_images.h"
#include "test_data.h"

namespace ktgp_orb {
namespace {

using Descriptor = std::array<std::uint8_t, kTeblidBits / 8>;

struct OracleFile {
  cv::Size image_size;
  std::vector<cv::KeyPoint> keypoints;
  std::vector<Descriptor> descriptors;
};

// One row of an oracle file: x, y, size, angle and the descriptor in hexadecimal.
bool readRow(const std::string& line, cv::KeyPoint& keypoint, Descriptor& descriptor) {
  char hex[65] = {};
  if (std::sscanf(line.c_str(), "%f,%f,%f,%f,%64[0-9a-f]", &keypoint.pt.x, &keypoint.pt.y,
                  &keypoint.size, &keypoint.angle, hex) != 5) {
    return false;
  }
  for (std::size_t i = 0; i < descriptor.size(); ++i) {
    descriptor[i] = static_cast<std::uint8_t>(std::stoi(std::string(hex + 2 * i, 2), nullptr, 16));
  }
  return true;
}

OracleFile readOracle(const std::string& file) {
  OracleFile oracle;
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  EXPECT_EQ(
      std::sscanf(line.c_str(), "# %d x %d", &oracle.image_size.width, &oracle.image_size.height),
      2)
      << file << ": unreadable first line: " << line;
  while (std::getline(in, line)) {
    oracle.keypoints.emplace_back();
    oracle.descriptors.emplace_back();
    EXPECT_TRUE(readRow(line, oracle.keypoints.back(), oracle.descriptors.back())) << line;
  }
  return oracle;
}

Descriptor describe(const cv::Mat& integral, const cv::KeyPoint& keypoint) {
  Descriptor descriptor{};
  describeTeblid(integral, keypoint, descriptor.data());
  return descriptor;
}

cv::Mat integralOf(const cv::Mat& image) {
  cv::Mat integral;
  integralImage(image, integral);
  return integral;
}

class TeblidOracle : public testing::TestWithParam<const char*> {};

TEST_P(TeblidOracle, GivesTheAuthorsDescriptors) {
  const auto folder = test::oracleFolder();
  const auto data = test::dataFolder();
  KTGP_ORB_REQUIRE_FOLDER(folder, "KTGP_ORB_ORACLE");
  KTGP_ORB_REQUIRE_FOLDER(data, "KTGP_ORB_DATA");
  const std::string name = GetParam();  // "<set>_<image>"
  const std::string set = name.substr(0, name.find('_'));
  const std::string file = *data + "/oxford/" + set + "/img" + name.substr(name.find('_') + 1);
  cv::Mat image = cv::imread(file + ".ppm", cv::IMREAD_GRAYSCALE);
  if (image.empty()) image = cv::imread(file + ".pgm", cv::IMREAD_GRAYSCALE);
  const OracleFile oracle = readOracle(*folder + "/teblid/" + name + ".csv");
  ASSERT_EQ(image.size(), oracle.image_size);
  ASSERT_GE(oracle.keypoints.size(), 600U);
  const cv::Mat integral = integralOf(image);
  for (std::size_t i = 0; i < oracle.keypoints.size(); ++i) {
    EXPECT_EQ(describe(integral, oracle.keypoints[i]), oracle.descriptors[i])
        << name << ", row " << i + 2;
  }
}

INSTANTIATE_TEST_SUITE_P(AllFiles, TeblidOracle, testing::Values("bikes_4", "boat_3", "leuven_1"),
                         [](const auto& tested) { return std::string(tested.param); });

// Bits of a descriptor that a flat image must give: 0 <= threshold.
TEST(Teblid, ComparesEqualMeansInAFlatImage) {
  for (int grey : {0, 7, 255}) {
    const cv::Mat integral = integralOf(test::flatImage({200, 150}, grey));
    for (const cv::Point2f& point : {cv::Point2f(100, 75), cv::Point2f(0, 0), cv::Point2f(199, 1),
                                     cv::Point2f(-40, 300), cv::Point2f(100, 149)}) {
      const Descriptor actual = describe(integral, cv::KeyPoint(point, 31.f, 77.f));
      for (int i = 0; i < kTeblidBits; ++i) {
        const bool bit = (actual[static_cast<std::size_t>(i) / 8] & (0x80 >> (i % 8))) != 0;
        ASSERT_EQ(bit, kTeblidTable.threshold[i] >= 0) << "bit " << i << " at " << point;
      }
    }
  }
}

// Sums beyond 2^31 begin again at the other end of the range, which their differences do not see.
TEST(Teblid, IsTheSameWhereTheSumsOverflow) {
  const cv::Mat image = test::textureImage({200, 150}, 3);
  const cv::Mat integral = integralOf(image);
  cv::Mat shifted = integral.clone();
  for (int y = 0; y < shifted.rows; ++y) {
    auto* row = shifted.ptr<std::uint32_t>(y);
    for (int x = 0; x < shifted.cols; ++x) row[x] += 0x7FF00000U;
  }
  for (int x = 0; x < 200; x += 7) {
    const cv::KeyPoint keypoint(static_cast<float>(x), 70.f, 31.f, static_cast<float>(3 * x));
    EXPECT_EQ(describe(shifted, keypoint), describe(integral, keypoint)) << x;
  }
}

// The border is where the mean of what is left begins to count: far inside and at the border the
// same box gives the same bit, so a frame added around the image changes nothing but the borders.
TEST(Teblid, SeesTheSameInAPartOfAnImage) {
  const cv::Mat image = test::textureImage({300, 280}, 5);
  const cv::Mat whole = integralOf(image);
  const cv::Mat part = integralOf(image(cv::Rect(64, 64, 172, 152)));
  for (float angle : {-1.f, 0.f, 45.f, 181.5f}) {
    const Descriptor expected = describe(whole, cv::KeyPoint(150.f, 130.f, 37.2f, angle));
    EXPECT_EQ(describe(part, cv::KeyPoint(86.f, 66.f, 37.2f, angle)), expected) << angle;
  }
}

// Nothing to compare with but that it neither reads outside the sums nor takes for ever.
TEST(Teblid, DescribesAnyKeypointOfAnyImage) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  for (const cv::Size& size : {cv::Size(1, 1), cv::Size(2, 5), cv::Size(70, 1), cv::Size(64, 64)}) {
    const cv::Mat integral = integralOf(test::noiseImage(size, 9));
    for (float x : {0.f, 0.5f, 31.f, 63.f, -1e9f, 1e30f, nan, infinity}) {
      for (float keypoint_size : {0.f, 1.f, 7.f, 31.f, 1e9f, -31.f, nan, infinity}) {
        for (float angle : {-1.f, 0.f, 359.9f, 1e9f, nan}) {
          describe(integral, cv::KeyPoint(x, 63.f - x, keypoint_size, angle));
        }
      }
    }
  }
}

}  // namespace
}  // namespace ktgp_orb
