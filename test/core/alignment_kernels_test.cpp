#include "core/alignment/kernels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <opencv2/core.hpp>
#include <random>

#include "instruction_sets.h"

namespace ktgp_orb::alignment {
namespace {

cv::Mat randomImage(std::mt19937& generator, bool extreme) {
  cv::Mat image(100, 117, CV_8U);
  std::uniform_int_distribution<int> grey(0, 255);
  image.forEach<std::uint8_t>([&](std::uint8_t& value, const int*) { value = 0; });
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const int value = grey(generator);
      image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(extreme ? 255 * (value & 1) : value);
    }
  }
  return image;
}

AffineWalk randomWalk(std::mt19937& generator) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto fixed = [](double x) { return static_cast<std::int32_t>(std::lrint(65536.0 * x)); };
  const double a = 1.4 * uniform(generator);
  const double b = 1.4 * uniform(generator);
  const double c = 1.4 * uniform(generator);
  const double d = 1.4 * uniform(generator);
  return {fixed(-10 * (a + b) + uniform(generator)),
          fixed(-10 * (c + d) + uniform(generator)),
          fixed(a),
          fixed(c),
          fixed(b),
          fixed(d)};
}

// The sums of a whole patch must have the same bits for every width of the vectors.
TEST(AlignmentKernels, EqualThePlainLoopsToTheLastBit) {
  const AlignmentKernels& plain = portableAlignmentKernels();
  for (const AlignmentKernels* set : test::everyKernels(bestAlignmentKernels, plain)) {
    SCOPED_TRACE(set->name);
    std::mt19937 generator(3);
    std::uniform_real_distribution<float> fraction(0.F, 1.F);
    for (int trial = 0; trial < 200; ++trial) {
      const cv::Mat image = randomImage(generator, trial % 5 == 0);
      const AffineWalk walk = randomWalk(generator);
      const auto stride = static_cast<std::ptrdiff_t>(image.step);
      alignas(64) float patch[2][kWarpSide * kWarpPitch];
      alignas(64) float window[2][kWindowSide * kWindowPitch];
      PatchTemplate prepared[2];
      const AlignmentKernels* kernels[2] = {&plain, set};
      MatchSums matched[2];
      const float fx = fraction(generator);
      const float fy = fraction(generator);
      for (int k = 0; k < 2; ++k) {
        std::memset(window[k], 0, sizeof window[k]);
        std::memset(&prepared[k], 0, sizeof prepared[k]);  // also what lies behind its last member
        kernels[k]->warp(image.ptr<std::uint8_t>(50) + 55, stride, walk, patch[k]);
        kernels[k]->prepare(patch[k], prepared[k]);
        kernels[k]->smooth(image.ptr<std::uint8_t>(20) + 31, stride, window[k]);
        matched[k] = kernels[k]->compare(window[k] + 3 * kWindowPitch + 7, fx, fy, prepared[k]);
      }
      ASSERT_EQ(std::memcmp(patch[0], patch[1], sizeof patch[0]), 0);
      ASSERT_EQ(std::memcmp(&prepared[0], &prepared[1], sizeof prepared[0]), 0);
      for (int row = 0; row < kWindowSide; ++row) {
        const int first = row * kWindowPitch;
        ASSERT_EQ(std::memcmp(window[0] + first, window[1] + first, sizeof(float) * kWindowSide),
                  0);
      }
      ASSERT_EQ(std::memcmp(&matched[0], &matched[1], sizeof matched[0]), 0);
    }
  }
}

TEST(AlignmentKernels, WarpInterpolatesBetweenFourPixels) {
  cv::Mat image(60, 80, CV_8U);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) image.at<std::uint8_t>(y, x) = x + 2 * y;  // a plane
  }
  const AffineWalk walk{-300000, -400000, 60000, -9000, 12000, 70000};
  float patch[kWarpSide * kWarpPitch];
  portableAlignmentKernels().warp(image.ptr<std::uint8_t>(25) + 30,
                                  static_cast<std::ptrdiff_t>(image.step), walk, patch);
  for (int row = 0; row < kWarpSide; ++row) {
    for (int column = 0; column < kWarpSide; ++column) {
      const double x = (walk.x0 + column * walk.x_column + row * walk.x_row) / 65536.0;
      const double y = (walk.y0 + column * walk.y_column + row * walk.y_row) / 65536.0;
      ASSERT_NEAR(patch[row * kWarpPitch + column], 30 + x + 2 * (25 + y), 0.02);
    }
  }
}

}  // namespace
}  // namespace ktgp_orb::alignment
