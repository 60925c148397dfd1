#include "ktgp_orb/orb_extractor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>

#include "core/orb/kernels.h"
#include "core/orb/pipeline.h"
#include "instruction_sets.h"
#include "orb_test_images.h"
#include "test_data.h"

namespace ktgp_orb {
namespace {

using orb::bestOrbKernels;
using orb::OrbKernels;
using orb::OrbPipeline;
using orb::portableOrbKernels;

using cv::Size;

Features opencvFeatures(const cv::Mat& image, const OrbOptions& options,
                        const cv::Mat& mask = cv::Mat()) {
  Features features;
  cv::ORB::create(options.max_features, static_cast<float>(options.scale_factor), options.levels,
                  31, options.first_level, 2, cv::ORB::HARRIS_SCORE, 31, options.fast_threshold)
      ->detectAndCompute(image, mask, features.keypoints, features.descriptors);
  return features;
}

// No tolerance: every float is compared bit for bit, in order.
void expectEqual(const Features& actual, const Features& expected, const std::string& what) {
  SCOPED_TRACE(what);
  ASSERT_EQ(actual.size(), expected.size());
  for (std::size_t i = 0; i < actual.size(); ++i) {
    const cv::KeyPoint& a = actual.keypoints[i];
    const cv::KeyPoint& e = expected.keypoints[i];
    ASSERT_EQ(a.pt, e.pt) << i;
    ASSERT_EQ(a.response, e.response) << i;
    ASSERT_EQ(a.angle, e.angle) << i;
    ASSERT_EQ(a.size, e.size) << i;
    ASSERT_EQ(a.octave, e.octave) << i;
    ASSERT_EQ(a.class_id, e.class_id) << i;
  }
  ASSERT_EQ(actual.descriptors.rows, expected.descriptors.rows);
  if (actual.empty()) return;
  ASSERT_EQ(actual.descriptors.size(), expected.descriptors.size());
  EXPECT_EQ(cv::norm(actual.descriptors, expected.descriptors, cv::NORM_INF), 0.0);
}

// Two things in cv::ORB depend on the platform; these tests avoid both:
// - Versions before 4.6 divide by the scale to size a pyramid level where 4.6 multiplies by its
//   inverse: the level may be a pixel larger or smaller.
// - Its blur uses fused multiply-adds where the processor has them and the library has code for
// them
//   (x86: AVX2); elsewhere about three pixels in a million differ by one grey value.
class OrbBesideOpencv : public testing::Test {
 protected:
  void SetUp() override {
    if (CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR < 406) {
      GTEST_SKIP() << "compares with cv::ORB of OpenCV 4.6 or later; this is " << CV_VERSION;
    }
    if (!cv::checkHardwareSupport(CV_CPU_AVX2)) {
      GTEST_SKIP() << "compares with cv::ORB as it rounds on processors with AVX2";
    }
  }
};

void expectOpencvsAnswer(const cv::Mat& image, const OrbOptions& options, const std::string& what,
                         const cv::Mat& mask = cv::Mat()) {
  Features features;
  OrbExtractor(options).extract(image, mask, features);
  expectEqual(features, opencvFeatures(image, options, mask), what);
}

TEST_F(OrbBesideOpencv, AgreesOnTheOxfordImages) {
  KTGP_ORB_REQUIRE_FOLDER(test::dataFolder(), "KTGP_ORB_DATA");
  for (const std::string set : {"leuven", "bikes", "boat"}) {
    for (int i = 1; i <= 6; ++i) {
      const cv::Mat image = test::oxfordImage(set, i);
      ASSERT_FALSE(image.empty()) << set << i;
      expectOpencvsAnswer(image, OrbOptions(), set + std::to_string(i));
    }
  }
}

TEST_F(OrbBesideOpencv, AgreesOnEveryKindOfImage) {
  const Size size(401, 333);
  OrbOptions options;
  for (int features : {1, 7, 500, 2000, 20000}) {
    options.max_features = features;
    const std::string n = " with " + std::to_string(features) + " features";
    expectOpencvsAnswer(test::textureImage(size, 1), options, "texture" + n);
    expectOpencvsAnswer(test::noiseImage(size, 2), options, "noise" + n);
    expectOpencvsAnswer(test::blockImage(size, 3), options, "blocks" + n);
    expectOpencvsAnswer(test::flatImage(size, 128), options, "flat" + n);
    expectOpencvsAnswer(test::gradientImage(size), options, "gradient" + n);
    expectOpencvsAnswer(test::checkerboardImage(size, 16), options, "checkerboard" + n);
    expectOpencvsAnswer(test::checkerboardImage(size, 1), options, "fine checkerboard" + n);
  }
}

TEST_F(OrbBesideOpencv, AgreesForOtherOptions) {
  const cv::Mat image = test::textureImage(Size(320, 240), 4);
  for (double scale_factor : {1.01, 1.1, 1.3, 1.41, 2.0}) {
    for (int levels : {1, 2, 5, 16}) {
      for (int threshold : {1, 5, 60, 255}) {
        OrbOptions options;
        options.max_features = 700;
        options.scale_factor = scale_factor;
        options.levels = levels;
        options.fast_threshold = threshold;
        // cv::ORB throws if a level has no pixels.
        if (std::pow(scale_factor, levels) > 400) continue;
        expectOpencvsAnswer(image, options,
                            "scale " + std::to_string(scale_factor) + " levels " +
                                std::to_string(levels) + " threshold " + std::to_string(threshold));
      }
    }
  }
}

TEST_F(OrbBesideOpencv, AgreesWithLevelsLargerThanTheImage) {
  OrbOptions options;
  options.max_features = 700;
  options.levels = 16;
  cv::Mat disc = cv::Mat::zeros(240, 320, CV_8U);
  cv::circle(disc, {180, 150}, 90, cv::Scalar(255), cv::FILLED);
  for (const int first : {1, 4, 8, 15}) {
    options.first_level = first;
    const std::string level = "first level " + std::to_string(first);
    expectOpencvsAnswer(test::textureImage(Size(320, 240), 4), options, level);
    expectOpencvsAnswer(test::noiseImage(Size(40, 50), 5), options, level + ", small");
    expectOpencvsAnswer(test::blockImage(Size(320, 240), 6), options, level + ", disc", disc);
  }
}

TEST(OrbExtractor, RefusesAFirstLevelThatIsNone) {
  OrbOptions options;
  for (const int first : {-1, 8}) {
    options.first_level = first;
    EXPECT_THROW(OrbExtractor{options}, std::invalid_argument) << first;
  }
  options.first_level = 3;
  options.descriptor = DescriptorKind::teblid;
  EXPECT_THROW(OrbExtractor{options}, std::invalid_argument);
}

TEST_F(OrbBesideOpencv, AgreesForEverySmallSize) {
  OrbOptions options;
  options.max_features = 300;
  for (int width = 2; width <= 140; width += 3) {
    for (int height : {2, 40, 61, 62, 63, 64, 65, 75, 90, 127}) {
      expectOpencvsAnswer(test::noiseImage(Size(width, height), 5), options,
                          std::to_string(width) + "x" + std::to_string(height));
    }
  }
  for (int side = 63; side <= 260; ++side) {
    expectOpencvsAnswer(test::noiseImage(Size(side, 323 - side), 6), options,
                        std::to_string(side) + " wide");
  }
}

TEST_F(OrbBesideOpencv, AgreesForLargeSizes) {
  for (const Size& size : {Size(1921, 1081), Size(1280, 720), Size(3000, 70), Size(70, 2000)}) {
    expectOpencvsAnswer(test::textureImage(size, 7), OrbOptions(), std::to_string(size.width));
  }
}

// cv::ORB 4.6 throws for one pixel, because a level shrinks to no pixels at all.
TEST(OrbExtractor, FindsNothingInAnImageOfNoneOrOnePixel) {
  for (const Size& size :
       {Size(), Size(1, 1), Size(1, 100), Size(100, 1), Size(62, 500), Size(500, 62)}) {
    Features features;
    features.keypoints.resize(3);
    OrbExtractor().extract(size.empty() ? cv::Mat() : test::noiseImage(size, 8), features);
    EXPECT_TRUE(features.empty());
    EXPECT_EQ(features.descriptors.rows, 0);
    EXPECT_EQ(features.image_size, size);
  }
}

TEST_F(OrbBesideOpencv, AgreesForRowsOfAnyStride) {
  for (int width : {100, 161, 240}) {
    const cv::Mat image = test::textureImage(Size(width, 130), 9);
    for (int padding : {1, 2, 5, 31, 64}) {
      expectOpencvsAnswer(test::asRegion(image, padding, 2 * padding + 1), OrbOptions(),
                          std::to_string(width) + " padded by " + std::to_string(padding));
    }
  }
}

TEST_F(OrbBesideOpencv, AgreesUnderAMask) {
  const cv::Mat image = test::textureImage(Size(400, 300), 10);
  cv::Mat disc = cv::Mat::zeros(image.size(), CV_8U);
  cv::circle(disc, {180, 150}, 110, cv::Scalar(255), cv::FILLED);
  expectOpencvsAnswer(image, OrbOptions(), "disc", disc);
  expectOpencvsAnswer(image, OrbOptions(), "any value above zero", disc / 100);
  expectOpencvsAnswer(image, OrbOptions(), "noise", test::noiseImage(image.size(), 11) > 20);
  expectOpencvsAnswer(image, OrbOptions(), "nowhere", disc * 0);
  expectOpencvsAnswer(image, OrbOptions(), "region", test::asRegion(disc, 3, 4));
}

TEST_F(OrbBesideOpencv, AgreesOnceTheMaskIsGone) {
  const cv::Mat image = test::textureImage(Size(300, 200), 12);
  cv::Mat mask = cv::Mat::zeros(image.size(), CV_8U);
  mask.colRange(0, 150).setTo(255);
  OrbExtractor extractor;
  Features features;
  extractor.extract(image, mask, features);
  extractor.extract(image, features);
  expectEqual(features, opencvFeatures(image, OrbOptions()), "second image");
}

TEST_F(OrbBesideOpencv, AgreesForImagesOfChangingSize) {
  OrbExtractor extractor;
  Features features;
  for (const Size& size : {Size(640, 480), Size(90, 70), Size(320, 500), Size(641, 479)}) {
    const cv::Mat image = test::blockImage(size, 13);
    extractor.extract(image, features);
    expectEqual(features, opencvFeatures(image, OrbOptions()), std::to_string(size.width));
  }
}

TEST_F(OrbBesideOpencv, AgreesWithEveryInstructionSet) {
  const cv::Mat images[] = {test::textureImage(Size(323, 241), 14),
                            test::noiseImage(Size(181, 97), 15),
                            test::checkerboardImage(Size(200, 200), 9)};
  OrbOptions options;
  for (const OrbKernels* kernels : test::everyKernels(bestOrbKernels, portableOrbKernels())) {
    OrbPipeline pipeline(options, *kernels);
    for (const cv::Mat& image : images) {
      Features features;
      pipeline.extract(image, cv::Mat(), features);
      expectEqual(features, opencvFeatures(image, options), kernels->name);
    }
  }
}

TEST_F(OrbBesideOpencv, AgreesForEveryNumberOfThreads) {
  const cv::Mat image = test::textureImage(Size(501, 377), 16);
  for (int threads = 0; threads <= 8; ++threads) {
    OrbOptions options;
    options.threads = threads;
    expectOpencvsAnswer(image, options, std::to_string(threads) + " threads");
  }
}

TEST(OrbExtractor, RefusesWhatItCannotTake) {
  Features features;
  OrbExtractor extractor;
  const cv::Mat image = test::flatImage(Size(100, 80), 0);
  EXPECT_THROW(extractor.extract(cv::Mat(80, 100, CV_8UC3), features), std::invalid_argument);
  EXPECT_THROW(extractor.extract(cv::Mat(80, 100, CV_16U), features), std::invalid_argument);
  EXPECT_THROW(extractor.extract(image, cv::Mat(80, 99, CV_8U), features), std::invalid_argument);
  EXPECT_THROW(extractor.extract(image, cv::Mat(80, 100, CV_8UC3), features),
               std::invalid_argument);
}

TEST(OrbExtractor, RefusesOptionsOutsideTheirRange) {
  const auto refuses = [](auto change) {
    OrbOptions options;
    change(options);
    EXPECT_THROW(OrbExtractor{options}, std::invalid_argument);
  };
  refuses([](OrbOptions& o) { o.max_features = 0; });
  refuses([](OrbOptions& o) { o.scale_factor = 1.0; });
  refuses([](OrbOptions& o) { o.scale_factor = std::nan(""); });
  refuses([](OrbOptions& o) { o.levels = 17; });
  refuses([](OrbOptions& o) { o.fast_threshold = 0; });
  refuses([](OrbOptions& o) { o.threads = -1; });
}

}  // namespace
}  // namespace ktgp_orb
