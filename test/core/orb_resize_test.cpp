#include "core/orb/pyramid.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "instruction_sets.h"
#include "orb_test_images.h"

namespace ktgp_orb::orb {
namespace {

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
  cv::Mat actual;
  for (int width : {100, 37, 64, 63, 190}) {
    const cv::Mat image = test::asRegion(test::noiseImage(cv::Size(width, 50), 3), 5, 1);
    const cv::Size size(width * 5 / 6, 43);
    cv::Mat expected;
    cv::resize(image, expected, size, 0, 0, cv::INTER_LINEAR_EXACT);
    shrinker.shrink(image, size, bestOrbKernels(), actual);
    EXPECT_EQ(cv::norm(actual, expected, cv::NORM_INF), 0.0) << width;
  }
}

}  // namespace
}  // namespace ktgp_orb::orb
