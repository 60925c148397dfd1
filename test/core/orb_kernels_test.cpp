#include "core/orb/kernels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/features2d.hpp>
#include <vector>

#include "core/orb/detector.h"
#include "instruction_sets.h"
#include "orb_test_images.h"

namespace ktgp_orb::orb {
namespace {

using cv::Size;

// Pixel values at the ends of the range push every sum to its limit.
std::vector<cv::Mat> hardImages(const Size& size) {
  return {test::noiseImage(size, 1),        test::noiseImage(size, 2) > 127,
          test::checkerboardImage(size, 7), test::checkerboardImage(size, 1),
          test::flatImage(size, 255),       test::flatImage(size, 0),
          test::textureImage(size, 3)};
}

std::vector<cv::KeyPoint> opencvCorners(const cv::Mat& image, int threshold) {
  std::vector<cv::KeyPoint> corners;
  cv::FAST(image, corners, threshold, true);
  cv::KeyPointsFilter::runByImageBorder(corners, image.size(), kEdgeMargin);
  return corners;
}

void expectSame(const std::vector<cv::KeyPoint>& corners,
                const std::vector<cv::KeyPoint>& expected) {
  ASSERT_EQ(corners.size(), expected.size());
  for (std::size_t i = 0; i < corners.size(); ++i) {
    ASSERT_EQ(corners[i].pt, expected[i].pt);
    ASSERT_EQ(corners[i].response, expected[i].response);
  }
}

class OrbKernelsTest : public testing::TestWithParam<const OrbKernels*> {
 protected:
  const OrbKernels& kernels() const { return *GetParam(); }
  const OrbKernels& plain() const { return portableOrbKernels(); }
};

TEST_P(OrbKernelsTest, FindsOpencvsFastCorners) {
  FastScratch scratch;
  std::vector<cv::KeyPoint> corners;
  for (const Size& size : {Size(200, 150), Size(63, 63), Size(64, 90), Size(127, 70)}) {
    for (const cv::Mat& image : hardImages(size)) {
      for (int threshold : {1, 7, 20, 100, 254, 255}) {
        corners.clear();
        fastCorners(image, kEdgeMargin, image.rows - kEdgeMargin, threshold, kernels(), scratch,
                    corners);
        ASSERT_NO_FATAL_FAILURE(expectSame(corners, opencvCorners(image, threshold)));
      }
    }
  }
}

TEST_P(OrbKernelsTest, FindsTheSameCornersBandByBand) {
  const cv::Mat image = test::noiseImage(Size(150, 140), 4);
  FastScratch scratch;
  std::vector<cv::KeyPoint> corners;
  for (int y = kEdgeMargin; y < image.rows - kEdgeMargin; y += 13) {
    fastCorners(image, y, std::min(y + 13, image.rows - kEdgeMargin), 20, kernels(), scratch,
                corners);
  }
  expectSame(corners, opencvCorners(image, 20));
}

TEST_P(OrbKernelsTest, ScoresEveryLengthOfRow) {
  const cv::Mat image = test::noiseImage(Size(300, 20), 5);
  const auto stride = static_cast<std::ptrdiff_t>(image.step);
  std::vector<std::uint8_t> expected(400);
  std::vector<std::uint8_t> actual(400);
  for (int count = 1; count <= 200; ++count) {
    plain().fast_scores(image.ptr(5) + 3, stride, count, 10, expected.data());
    kernels().fast_scores(image.ptr(5) + 3, stride, count, 10, actual.data());
    ASSERT_TRUE(std::equal(actual.begin(), actual.begin() + count, expected.begin())) << count;
  }
}

TEST_P(OrbKernelsTest, FindsTheMaximaOfEveryLengthOfRow) {
  // Few different values: ties, which are not maxima, are frequent.
  const cv::Mat scores = test::noiseImage(Size(300, 3), 6) / 50;
  std::vector<std::int32_t> expected(200);
  std::vector<std::int32_t> actual(200);
  for (int count = 1; count <= 200; ++count) {
    const auto find = [&](const OrbKernels& set, std::vector<std::int32_t>& maxima) {
      return set.local_maxima(scores.ptr(0) + 1, scores.ptr(1) + 1, scores.ptr(2) + 1, count,
                              maxima.data());
    };
    const int found = find(plain(), expected);
    ASSERT_EQ(find(kernels(), actual), found);
    ASSERT_TRUE(std::equal(actual.begin(), actual.begin() + found, expected.begin())) << count;
  }
}

TEST_P(OrbKernelsTest, GivesTheSameHarrisResponsesAndMoments) {
  for (const cv::Mat& image : hardImages(Size(90, 80))) {
    const auto stride = static_cast<std::ptrdiff_t>(image.step);
    for (int y = kEdgeMargin; y < image.rows - kEdgeMargin; ++y) {
      for (int x = kEdgeMargin; x < image.cols - kEdgeMargin; ++x) {
        const std::uint8_t* pixel = image.ptr(y) + x;
        ASSERT_EQ(kernels().harris(pixel, stride), plain().harris(pixel, stride));
        ASSERT_EQ(kernels().moments(pixel, stride), plain().moments(pixel, stride));
      }
    }
  }
}

TEST_P(OrbKernelsTest, ReachesTheLimitsOfTheMoments) {
  // One half of the disc white, the other black: the largest possible moments.
  for (bool vertical : {false, true}) {
    for (int white : {0, 255}) {
      cv::Mat image(70, 70, CV_8U, cv::Scalar(white));
      (vertical ? image.rowRange(0, 35) : image.colRange(0, 35)).setTo(255 - white);
      EXPECT_EQ(kernels().moments(image.ptr(35) + 35, 70), plain().moments(image.ptr(35) + 35, 70));
    }
  }
}

TEST_P(OrbKernelsTest, BlursEveryLengthOfRow) {
  const cv::Mat image = test::noiseImage(Size(300, 7), 7);
  std::vector<float> rows[2][7];
  std::vector<std::uint8_t> out[2];
  for (int count = 1; count <= 200; ++count) {
    const OrbKernels* sets[2] = {&plain(), &kernels()};
    for (int s = 0; s < 2; ++s) {
      const float* row_of[7];
      out[s].assign(300, 0);
      for (int i = 0; i < 7; ++i) {
        rows[s][i].assign(300, 0.f);
        sets[s]->blur_along_row(image.ptr(i) + 3, count, rows[s][i].data());
        row_of[i] = rows[s][i].data();
      }
      sets[s]->blur_across_rows(row_of, count, out[s].data());
    }
    // The order within every 64 values along a row depends on the kernels.
    for (int i = 0; i < 7 && count % 64 == 0; ++i) {
      for (auto& row : rows) std::sort(row[i].begin(), row[i].begin() + count);
      ASSERT_TRUE(std::equal(rows[0][i].begin(), rows[0][i].begin() + count, rows[1][i].begin()));
    }
    ASSERT_TRUE(std::equal(out[0].begin(), out[0].begin() + count, out[1].begin())) << count;
  }
}

TEST_P(OrbKernelsTest, DescribesAtEveryAngle) {
  const cv::Mat image = test::noiseImage(Size(64, 64), 8);
  const auto stride = static_cast<std::ptrdiff_t>(image.step);
  for (int i = 0; i < 36000; i += 7) {
    const float angle = static_cast<float>(i) / 100.f * static_cast<float>(CV_PI / 180.);
    std::uint8_t expected[32];
    std::uint8_t actual[32];
    plain().describe(image.ptr(31) + 31, stride, std::cos(angle), std::sin(angle), expected);
    kernels().describe(image.ptr(31) + 31, stride, std::cos(angle), std::sin(angle), actual);
    ASSERT_TRUE(std::equal(actual, actual + 32, expected)) << i / 100.0 << " degrees";
  }
}

INSTANTIATE_TEST_SUITE_P(EveryInstructionSet, OrbKernelsTest,
                         testing::ValuesIn(test::everyKernels(bestOrbKernels,
                                                              portableOrbKernels())),
                         [](const auto& tested) { return std::string(tested.param->name); });

TEST(OrbKernels, IncludesTheBestAndThePortableSet) {
  const std::vector<const OrbKernels*> all =
      test::everyKernels(bestOrbKernels, portableOrbKernels());
  EXPECT_EQ(all.front(), &bestOrbKernels());
  EXPECT_EQ(all.back(), &portableOrbKernels());
}

}  // namespace
}  // namespace ktgp_orb::orb
