#include "features/orb/kernels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "features/orb/detector.h"
#include "features/orb/pyramid.h"
#include "instruction_sets.h"
#include "orb_test_images.h"
#include "util/constants.h"

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

void expectOpencvsImage(const cv::Mat& image, const cv::Size& size) {
  cv::Mat expected;
  cv::resize(image, expected, size, 0, 0, cv::INTER_LINEAR_EXACT);
  for (const OrbKernels* kernels : test::everyKernels(bestOrbKernels, portableOrbKernels())) {
    Shrinker shrinker;
    cv::Mat actual;
    shrinker.shrink(image, size, *kernels, actual);
    ASSERT_EQ(actual.size(), size);
    EXPECT_EQ(cv::norm(actual, expected, cv::NORM_INF), 0.0)
        << kernels->name << ": " << image.size() << " to " << size;
  }
}

TEST(Shrinker, AgreesWithOpencvForEveryRatio) {
  for (int length = 20; length <= 300; length += 7) {
    const cv::Mat image = test::noiseImage(cv::Size(length, length + 1), 1);
    for (int target = length / 2 - 3; target <= length; target += 1 + length / 40) {
      expectOpencvsImage(image, cv::Size(target, length + 1 - length / 6));
      expectOpencvsImage(image, cv::Size(length - length / 6, target));
    }
  }
}

TEST(Shrinker, AgreesWithOpencvForThePyramidsOfUsualImages) {
  for (const cv::Size& size : {cv::Size(640, 480), cv::Size(1280, 720), cv::Size(1921, 1081)}) {
    cv::Mat image = test::textureImage(size, 2);
    for (int level = 1; level < 8; ++level) {
      const float scale = 1.f / static_cast<float>(std::pow(1.2, level));
      const cv::Size smaller(cvRound(size.width * scale), cvRound(size.height * scale));
      expectOpencvsImage(image, smaller);
      cv::resize(image, image, smaller, 0, 0, cv::INTER_LINEAR_EXACT);
    }
  }
}

TEST(Shrinker, TakesRowsOfAnyStrideAndImagesOfChangingSize) {
  Shrinker shrinker;
  cv::Mat actual, expected;
  for (int width : {100, 37, 64, 63, 190}) {
    const cv::Mat image = test::asRegion(test::noiseImage(cv::Size(width, 50), 3), 5, 1);
    const cv::Size size(width * 5 / 6, 43);
    cv::resize(image, expected, size, 0, 0, cv::INTER_LINEAR_EXACT);
    shrinker.shrink(image, size, bestOrbKernels(), actual);
    EXPECT_EQ(cv::norm(actual, expected, cv::NORM_INF), 0.0) << width;
  }
}

using util::kPi;

/// Calls visit(y, x) with integer vectors of all lengths, like the moments of a patch.
template <typename Visit>
void forEachVector(const Visit& visit) {
  std::uint64_t state = 1;
  const auto next = [&](int bits) {
    state = state * 6364136223846793005U + 1442695040888963407U;
    return static_cast<float>(static_cast<std::int32_t>(state >> 32) >> (32 - bits));
  };
  for (int i = 0; i < 200000; ++i) {
    const int bits = 4 + i % 20;
    const float y = next(bits);
    visit(y, next(bits));
  }
}

TEST(VectorAngle, EqualsArcTangent) {
  forEachVector([](float y, float x) {
    if (x == 0.f && y == 0.f) return;
    const double exact = std::atan2(y, x) * 180 / kPi;
    const double difference = std::abs(vectorAngle(y, x) - (exact < 0 ? exact + 360 : exact));
    EXPECT_LT(difference, 0.012) << y << ", " << x;
  });
}

TEST(VectorAngle, IsExactOnTheAxes) {
  EXPECT_EQ(vectorAngle(0.f, 0.f), 0.f);
  EXPECT_EQ(vectorAngle(0.f, 5.f), 0.f);
  EXPECT_EQ(vectorAngle(5.f, 0.f), 90.f);
  EXPECT_EQ(vectorAngle(0.f, -5.f), 180.f);
  EXPECT_EQ(vectorAngle(-5.f, 0.f), 270.f);
}

// FNV-1a of all bits, recorded on x86-64. Fused multiply-adds would change it.
TEST(VectorAngle, HasTheSameBitsEverywhere) {
  std::uint64_t hash = 0xcbf29ce484222325U;
  forEachVector([&](float y, float x) {
    const float angle = vectorAngle(y, x);
    std::uint32_t bits;
    std::memcpy(&bits, &angle, sizeof bits);
    hash = (hash ^ bits) * 0x100000001b3U;
  });
  EXPECT_EQ(hash, 0x2d315b563cc708c2U);
}

#if defined(__x86_64__)
TEST(VectorAngle, EqualsOpencv) {
  forEachVector([](float y, float x) { EXPECT_EQ(vectorAngle(y, x), cv::fastAtan2(y, x)); });
}
#endif

}  // namespace
}  // namespace ktgp_orb::orb
