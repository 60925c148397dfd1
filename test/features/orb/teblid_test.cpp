// Compares TEBLID with the descriptors of its authors' program, and its vector code with the plain
// definition.
#include "features/orb/teblid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "features/orb/teblid_table.h"
#include "frame_pair.h"
#include "instruction_sets.h"
#include "orb_test_images.h"
#include "test_data.h"

namespace ktgp_orb::orb {
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

/// Whether the descriptor has the bit, as in its authors' program.
bool hasBit(const Descriptor& descriptor, int bit) {
  return (descriptor[static_cast<std::size_t>(bit) / 8] & (0x80 >> (bit % 8))) != 0;
}

Descriptor describe(const cv::Mat& integral, const cv::KeyPoint& keypoint) {
  Descriptor descriptor{};
  describeTeblid(integral, keypoint, descriptor.data());
  return descriptor;
}

cv::Mat integralOf(const cv::Mat& image) {
  cv::Mat integral;
  cv::integral(image, integral, CV_32S);
  return integral;
}

class TeblidOracle : public testing::TestWithParam<const char*> {};

TEST_P(TeblidOracle, GivesTheAuthorsDescriptors) {
  const auto folder = test::oracleFolder();
  KTGP_ORB_REQUIRE_FOLDER(folder, "KTGP_ORB_ORACLE");
  KTGP_ORB_REQUIRE_FOLDER(test::dataFolder(), "KTGP_ORB_DATA");
  const std::string name = GetParam();  // "<set>_<image>"
  const std::size_t mark = name.find('_');
  const cv::Mat image = test::oxfordImage(name.substr(0, mark), std::stoi(name.substr(mark + 1)));
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

/// Mean grey value of a square, cut at the border of the image.
double meanOf(const cv::Mat& image, double x, double y, double radius) {
  const int r = static_cast<int>(radius + 0.5);
  const cv::Point centre(cvFloor(x + 0.5), cvFloor(y + 0.5));
  const cv::Rect square(centre.x - r, centre.y - r, 2 * r + 1, 2 * r + 1);
  return cv::mean(image(square & cv::Rect({0, 0}, image.size())))[0];
}

// The paper's definition in double precision, box by box: only where the rounding to single
// precision matters does a bit differ.
TEST(Teblid, ComparesTheBoxesOfThePaper) {
  const cv::Mat image = test::textureImage({320, 240}, 4);
  const cv::Mat integral = integralOf(image);
  cv::RNG rng(5);
  int wrong = 0;
  constexpr int kKeypoints = 200;
  for (int k = 0; k < kKeypoints; ++k) {
    const cv::KeyPoint keypoint(rng.uniform(43.F, 277.F), rng.uniform(43.F, 197.F),
                                rng.uniform(31.F, 60.F), rng.uniform(0.F, 360.F));
    const double scale = keypoint.size / kTeblidPatch;
    const double angle = keypoint.angle * CV_PI / 180.0;
    const auto mean = [&](int u, int v, int radius) {
      const double x = scale * (u - 0.5 * kTeblidPatch);
      const double y = scale * (v - 0.5 * kTeblidPatch);
      return meanOf(image, keypoint.pt.x + std::cos(angle) * x - std::sin(angle) * y,
                    keypoint.pt.y + std::sin(angle) * x + std::cos(angle) * y, scale * radius);
    };
    const Descriptor actual = describe(integral, keypoint);
    const TeblidTable& t = kTeblidTable;
    for (int i = 0; i < kTeblidBits; ++i) {
      const double difference = mean(t.first_x[i], t.first_y[i], t.radius[i]) -
                                mean(t.second_x[i], t.second_y[i], t.radius[i]);
      wrong += hasBit(actual, i) != (difference <= t.threshold[i]) ? 1 : 0;
    }
  }
  EXPECT_LT(wrong, kKeypoints * kTeblidBits / 1000);
}

// Bits that are set for a flat image: 0 <= threshold.
TEST(Teblid, ComparesEqualMeansInAFlatImage) {
  for (int grey : {0, 7, 255}) {
    const cv::Mat integral = integralOf(test::flatImage({200, 150}, grey));
    for (const cv::Point2f& point : {cv::Point2f(100, 75), cv::Point2f(0, 0), cv::Point2f(199, 1),
                                     cv::Point2f(-40, 300), cv::Point2f(100, 149)}) {
      const Descriptor actual = describe(integral, cv::KeyPoint(point, 31.f, 77.f));
      for (int i = 0; i < kTeblidBits; ++i) {
        ASSERT_EQ(hasBit(actual, i), kTeblidTable.threshold[i] >= 0) << i << " at " << point;
      }
    }
  }
}

// Sums beyond 2^31 overflow; their differences are still right.
TEST(Teblid, SameWhereSumsOverflow) {
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

// At the border, the mean is over the rest of a box. Far inside and at the border the same box
// gives the same bit, so a frame around the image changes only bits at the border.
TEST(Teblid, SeesTheSameInAPartOfAnImage) {
  const cv::Mat image = test::textureImage({300, 280}, 5);
  const cv::Mat whole = integralOf(image);
  const cv::Mat part = integralOf(image(cv::Rect(64, 64, 172, 152)));
  for (float angle : {-1.f, 0.f, 45.f, 181.5f}) {
    const Descriptor expected = describe(whole, cv::KeyPoint(150.f, 130.f, 37.2f, angle));
    EXPECT_EQ(describe(part, cv::KeyPoint(86.f, 66.f, 37.2f, angle)), expected) << angle;
  }
}

// There is no reference. What is around the sums in memory must not matter.
TEST(Teblid, ReadsOnlyTheSumsForAnyKeypointOfAnyImage) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  for (const cv::Size& size : {cv::Size(1, 1), cv::Size(2, 5), cv::Size(70, 1), cv::Size(64, 64)}) {
    const cv::Mat integral = integralOf(test::noiseImage(size, 9));
    const auto surroundedBy = [&](int value) {
      cv::Mat memory(integral.rows + 80, integral.cols + 80, integral.type(), cv::Scalar(value));
      cv::Mat part = memory(cv::Rect(40, 40, integral.cols, integral.rows));
      integral.copyTo(part);
      return part;
    };
    const cv::Mat one = surroundedBy(0);
    const cv::Mat other = surroundedBy(1 << 30);
    for (float x : {0.f, 0.5f, 31.f, 63.f, -1e9f, 1e30f, nan, infinity}) {
      for (float keypoint_size : {0.f, 1.f, 7.f, 31.f, 1e9f, -31.f, nan, infinity}) {
        for (float angle : {-1.f, 0.f, 359.9f, 1e9f, nan}) {
          const cv::KeyPoint keypoint(x, 63.f - x, keypoint_size, angle);
          ASSERT_EQ(describe(one, keypoint), describe(other, keypoint))
              << size << ", x " << x << ", size " << keypoint_size << ", angle " << angle;
        }
      }
    }
  }
}

const std::vector<float> kSizes = {31.f, 37.2f, 44.64f, 53.568f, 64.2816f, 77.13792f, 92.5655f};

// All sizes and angles, at fractions of a pixel, from far outside the image to its middle.
std::vector<cv::KeyPoint> keypointsEverywhere(const cv::Size& size) {
  cv::RNG rng(7);
  std::vector<cv::KeyPoint> keypoints;
  for (int i = 0; i < 1000; ++i) {
    const auto x = rng.uniform(-20.f, static_cast<float>(size.width) + 20.f);
    const auto y = rng.uniform(-20.f, static_cast<float>(size.height) + 20.f);
    const int octave = rng.uniform(-1, 9);
    const float keypoint_size =
        octave < 0 || octave > 6 ? 40.f : kSizes[static_cast<std::size_t>(octave)];
    keypoints.emplace_back(x, y, keypoint_size, rng.uniform(-1.f, 360.f), 0.f, octave);
  }
  return keypoints;
}

TEST(TeblidDescriber, GivesTheDefinitionsBitsWithEveryInstructionSet) {
  // A describer is used for all images: data of an image of another size must not matter.
  std::vector<TeblidDescriber> describers;
  const auto kernels = test::everyKernels(bestOrbKernels, portableOrbKernels());
  for (const OrbKernels* kernel : kernels) describers.emplace_back(kSizes, *kernel);
  for (const cv::Size& size : {cv::Size(320, 240), cv::Size(400, 300), cv::Size(63, 63),
                               cv::Size(1, 1), cv::Size(320, 200)}) {
    for (const cv::Mat& image : {test::textureImage(size, 11), test::noiseImage(size, 12),
                                 cv::Mat(test::noiseImage(size, 13) > 127)}) {
      const cv::Mat integral = integralOf(image);
      const std::vector<cv::KeyPoint> keypoints = keypointsEverywhere(size);
      std::vector<Descriptor> expected;
      for (const cv::KeyPoint& keypoint : keypoints) {
        expected.push_back(describe(integral, keypoint));
      }
      for (std::size_t k = 0; k < kernels.size(); ++k) {
        SCOPED_TRACE(kernels[k]->name);
        describers[k].setImage(image);
        for (std::size_t i = 0; i < keypoints.size(); ++i) {
          Descriptor actual{};
          describers[k].describe(keypoints[i], actual.data());
          ASSERT_EQ(actual, expected[i]) << size << ", keypoint " << i << " at " << keypoints[i].pt;
        }
      }
    }
  }
}

// The keypoints are ORB's; only the descriptors differ, and equal the definition's.
TEST(TeblidExtraction, DescribesOrbsKeypoints) {
  for (const cv::Size& size :
       {cv::Size(640, 480), cv::Size(63, 63), cv::Size(62, 400), cv::Size(64, 333)}) {
    const cv::Mat image = test::asRegion(test::textureImage(size, 21), 5, 9);
    const cv::Mat integral = integralOf(image);
    OrbOptions options;
    for (KeypointDistribution distribution :
         {KeypointDistribution::ranked, KeypointDistribution::uniform}) {
      options.distribution = distribution;
      options.descriptor = DescriptorKind::orb;
      const Features orb = test::featuresOf(image, options);
      options.descriptor = DescriptorKind::teblid;
      const Features teblid = test::featuresOf(image, options);
      EXPECT_EQ(orb.descriptor, DescriptorKind::orb);
      EXPECT_EQ(teblid.descriptor, DescriptorKind::teblid);
      ASSERT_EQ(teblid.size(), orb.size()) << size;
      ASSERT_EQ(teblid.descriptors.rows, orb.descriptors.rows) << size;
      for (std::size_t i = 0; i < orb.size(); ++i) {
        ASSERT_EQ(teblid.keypoints[i].pt, orb.keypoints[i].pt) << i;
        ASSERT_EQ(teblid.keypoints[i].angle, orb.keypoints[i].angle) << i;
        Descriptor actual{};
        std::copy_n(teblid.descriptors.ptr(static_cast<int>(i)), actual.size(), actual.data());
        ASSERT_EQ(actual, describe(integral, orb.keypoints[i])) << i;
      }
    }
  }
}

TEST(TeblidExtraction, SameForAnyNumberOfThreads) {
  const cv::Mat image = test::textureImage({320, 240}, 22);
  OrbOptions options;
  options.descriptor = DescriptorKind::teblid;
  const Features expected = test::featuresOf(image, options);
  ASSERT_GT(expected.size(), 500U);
  for (int threads : {2, 3, 5}) {
    options.threads = threads;
    EXPECT_EQ(
        cv::norm(test::featuresOf(image, options).descriptors, expected.descriptors, cv::NORM_INF),
        0.0);
  }
}

// 16 levels of half the size each: the last one never has keypoints, but its scale is computed.
TEST(TeblidScale, BoundsKeepTheirSignHoweverLargeTheKeypoint) {
  for (const float size : {31.0F, 31.0F * 32768.0F}) {
    const TeblidScale scale(size, 64);
    for (int bit = 0; bit < kTeblidBits; ++bit) {
      EXPECT_EQ(scale.bound[teblidPlace(bit)] > 0, kTeblidTable.threshold[bit] >= 0.0F)
          << "bit " << bit << " of a keypoint of " << size << " px";
    }
  }
}

}  // namespace
}  // namespace ktgp_orb::orb
