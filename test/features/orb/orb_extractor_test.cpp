#include "ktgp_orb/orb_extractor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <stdexcept>
#include <string>

#include "features/orb/kernels.h"
#include "features/orb/pipeline.h"
#include "features/orb/uniform.h"
#include "frame_pair.h"
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
    for (const auto& [name, image] : {std::pair("texture", test::textureImage(size, 1)),
                                      {"noise", test::noiseImage(size, 2)},
                                      {"blocks", test::blockImage(size, 3)},
                                      {"flat", test::flatImage(size, 128)},
                                      {"gradient", test::gradientImage(size)},
                                      {"checkerboard", test::checkerboardImage(size, 16)},
                                      {"fine checkerboard", test::checkerboardImage(size, 1)}}) {
      expectOpencvsAnswer(image, options, name + n);
    }
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
TEST(OrbExtractor, FindsNothingInEmptyAndOnePixelImages) {
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

TEST(OrbExtractor, RefusesUnusableInput) {
  Features features;
  OrbExtractor extractor;
  const cv::Mat image = test::flatImage(Size(100, 80), 0);
  EXPECT_THROW(extractor.extract(cv::Mat(80, 100, CV_8UC3), features), std::invalid_argument);
  EXPECT_THROW(extractor.extract(cv::Mat(80, 100, CV_16U), features), std::invalid_argument);
  EXPECT_THROW(extractor.extract(image, cv::Mat(80, 99, CV_8U), features), std::invalid_argument);
  EXPECT_THROW(extractor.extract(image, cv::Mat(80, 100, CV_8UC3), features),
               std::invalid_argument);
}

TEST(OrbExtractor, TakesAnImageThatTheResultHolds) {
  const cv::Mat image = test::blockImage(cv::Size(320, 240), 3);
  Features expected, features;
  OrbOptions options;
  options.images = ImageKeeping::none;
  OrbExtractor extractor(options);
  extractor.extract(image, expected);
  ASSERT_GT(expected.size(), 100U);
  features.images = {image.clone()};
  extractor.extract(features.images[0], features);
  EXPECT_EQ(features.size(), expected.size());
}

OrbOptions sharingImages() {
  OrbOptions options;
  options.images = ImageKeeping::share;
  return options;
}

TEST(OrbImages, AreMissingUnlessWanted) {
  Features features;
  OrbExtractor(sharingImages()).extract(test::textureImage(cv::Size(320, 240), 1), features);
  EXPECT_FALSE(features.images.empty());
  OrbOptions options;
  options.images = ImageKeeping::none;
  OrbExtractor(options).extract(test::textureImage(cv::Size(320, 240), 1), features);
  EXPECT_TRUE(features.images.empty());
}

TEST(OrbImages, HaveTheWantedRatio) {
  const cv::Mat image = test::textureImage(cv::Size(320, 240), 2);
  Features features;
  OrbExtractor(sharingImages()).extract(image, features);
  ASSERT_EQ(features.images.size(), 8u);
  EXPECT_EQ(features.images[0].data, image.data);
  for (std::size_t i = 1; i < features.images.size(); ++i) {
    const cv::Mat& level = features.images[i];
    EXPECT_NEAR(level.cols, 320 / std::pow(1.2, i), 0.6) << "level " << i;
    cv::Mat expected;
    cv::resize(features.images[i - 1], expected, level.size(), 0, 0, cv::INTER_LINEAR_EXACT);
    EXPECT_EQ(cv::norm(level, expected, cv::NORM_INF), 0.0) << "level " << i;
  }
}

TEST(OrbImages, LargerLevelsDoNotChangeThem) {
  const cv::Mat image = test::textureImage(cv::Size(120, 90), 2);
  OrbOptions options;
  Features plain, larger;
  OrbExtractor(options).extract(image, plain);
  options.first_level = 4;
  options.levels += 4;
  OrbExtractor(options).extract(image, larger);
  EXPECT_GT(larger.size(), plain.size());
  ASSERT_EQ(larger.images.size(), plain.images.size());
  for (std::size_t i = 0; i < plain.images.size(); ++i) {
    EXPECT_EQ(cv::norm(larger.images[i], plain.images[i], cv::NORM_INF), 0.0) << i;
  }
}

// A camera's loop reads every frame into the same matrix.
TEST(OrbImages, AreCopiedUnlessTheyAreShared) {
  cv::Mat image = test::textureImage(cv::Size(320, 240), 8);
  const cv::Mat before = image.clone();
  Features features;
  OrbExtractor extractor;
  extractor.extract(image, features);
  const Features kept = features;
  image.setTo(0);
  EXPECT_EQ(cv::norm(kept.images[0], before, cv::NORM_INF), 0.0);
  extractor.extract(image, features);
  EXPECT_EQ(cv::norm(kept.images[0], before, cv::NORM_INF), 0.0);
}

TEST(OrbImages, StayAsTheyAreWhileTheExtractorGoesOn) {
  OrbExtractor extractor(sharingImages());
  Features features;
  extractor.extract(test::textureImage(cv::Size(320, 240), 3), features);
  const Features kept = features;
  std::vector<cv::Mat> copies;
  for (const cv::Mat& image : kept.images) copies.push_back(image.clone());
  extractor.extract(test::textureImage(cv::Size(320, 240), 4), features);
  Features others;
  extractor.extract(test::textureImage(cv::Size(320, 240), 5), others);
  for (std::size_t i = 0; i < copies.size(); ++i) {
    EXPECT_EQ(cv::norm(kept.images[i], copies[i], cv::NORM_INF), 0.0) << "level " << i;
  }
}

TEST(OrbImages, KeepTheirMemoryAfterTwoFrames) {
  const cv::Mat images[] = {test::textureImage(cv::Size(320, 240), 6),
                            test::textureImage(cv::Size(320, 240), 7)};
  OrbExtractor extractor(sharingImages());
  Features frames[2];
  const auto extract = [&](int i) { extractor.extract(images[i % 2], frames[i % 2]); };
  for (int i = 0; i < 4; ++i) extract(i);
  const std::uint8_t* pixels[] = {frames[0].images[1].data, frames[1].images[1].data};
  for (int i = 0; i < 6; ++i) extract(i);
  EXPECT_EQ(frames[0].images[1].data, pixels[0]);
  EXPECT_EQ(frames[1].images[1].data, pixels[1]);
}

TEST(OrbExtractor, DoesNotOverwriteSharedDescriptors) {
  OrbExtractor extractor;
  Features features;
  extractor.extract(test::textureImage(cv::Size(320, 240), 3), features);
  const Features kept = features;
  const cv::Mat copy = kept.descriptors.clone();
  extractor.extract(test::textureImage(cv::Size(320, 240), 4), features);
  EXPECT_EQ(cv::norm(kept.descriptors, copy, cv::NORM_INF), 0.0);
}

}  // namespace
}  // namespace ktgp_orb

namespace ktgp_orb::orb {
namespace {

// Uniform distribution of the keypoints.

constexpr int kStrong = 20;
constexpr int kShare = 8;

// Random corners, more on the left, with scores of 10..59: some are weak.
std::vector<cv::KeyPoint> randomCorners(const Size& size, int count, std::uint64_t seed) {
  cv::RNG rng(seed);
  std::vector<cv::KeyPoint> corners;
  std::set<std::pair<int, int>> taken;
  while (static_cast<int>(corners.size()) < count) {
    const int x = std::min(rng.uniform(kEdgeMargin, size.width - kEdgeMargin),
                           rng.uniform(kEdgeMargin, size.width - kEdgeMargin));
    const int y = rng.uniform(kEdgeMargin, size.height - kEdgeMargin);
    if (!taken.emplace(x, y).second) continue;
    corners.emplace_back(static_cast<float>(x), static_cast<float>(y), 7.f, -1.f,
                         static_cast<float>(rng.uniform(10, 60)));
  }
  return corners;
}

std::vector<int> countPerCell(const LevelCells& grid, const std::vector<cv::KeyPoint>& keypoints) {
  std::vector<int> count(grid.count());
  for (const cv::KeyPoint& keypoint : keypoints) ++count[grid.cellOf(keypoint.pt)];
  return count;
}

struct Chosen {
  std::vector<cv::KeyPoint> keypoints;
  std::vector<int> before;  // corners per cell
  std::vector<int> after;
};

Chosen choose(const cv::Mat& image, int features, std::vector<cv::KeyPoint> corners) {
  const LevelCells grid(image.size(), features, kShare);
  Chosen result;
  result.before = countPerCell(grid, corners);
  UniformChoice choice(features, kStrong, kShare, 1);
  choice.sortIntoCells(0, image.size(), features, corners);
  choice.share(1);
  choice.keepShares(0, image, bestOrbKernels(), corners);
  result.after = countPerCell(grid, corners);
  result.keypoints = corners;
  return result;
}

TEST(UniformChoice, EveryCellGetsAnEqualShare) {
  const cv::Mat image = test::noiseImage(Size(400, 300), 1);
  for (int count : {0, 1, 5, 50, 200, 500, 1500, 4000}) {
    for (int features : {1, 3, 17, 100, 499, 1000}) {
      const Chosen chosen = choose(image, features, randomCorners(image.size(), count, 2));
      ASSERT_EQ(static_cast<int>(chosen.keypoints.size()), std::min(count, features));
      // Cells with too many corners keep the same number; some keep one more.
      int most = 0;
      for (int kept : chosen.after) most = std::max(most, kept);
      for (std::size_t i = 0; i < chosen.after.size(); ++i) {
        EXPECT_GE(chosen.after[i], std::min(chosen.before[i], most - 1))
            << "cell " << i << " of " << count << " corners for " << features;
      }
    }
  }
}

TEST(UniformChoice, PrefersStrongCornersAndThenHigherHarrisResponses) {
  const cv::Mat image = test::noiseImage(Size(400, 300), 3);
  const int features = 300;
  const std::vector<cv::KeyPoint> corners = randomCorners(image.size(), 2000, 4);
  const Chosen chosen = choose(image, features, corners);
  const LevelCells grid(image.size(), features, kShare);
  const auto key = [](const cv::KeyPoint& k) { return std::make_pair(k.pt.y, k.pt.x); };
  std::map<std::pair<float, float>, float> kept;
  for (const cv::KeyPoint& keypoint : chosen.keypoints) kept[key(keypoint)] = keypoint.response;
  std::vector<bool> keeps_weak(grid.count());
  std::vector<float> least_kept(grid.count(), 1e9f);
  for (const cv::KeyPoint& corner : corners) {
    const auto it = kept.find(key(corner));
    if (it == kept.end()) continue;
    const int cell = grid.cellOf(corner.pt);
    if (corner.response < kStrong) keeps_weak[cell] = true;
    if (corner.response >= kStrong) least_kept[cell] = std::min(least_kept[cell], it->second);
  }
  for (const cv::KeyPoint& corner : corners) {
    if (corner.response < kStrong || kept.count(key(corner)) != 0) continue;
    const int cell = grid.cellOf(corner.pt);
    EXPECT_FALSE(keeps_weak[cell]) << "a weak corner was kept before a strong one";
    EXPECT_LE(harrisResponse(image, portableOrbKernels(), corner.pt), least_kept[cell]);
  }
}

OrbOptions adaptive() {
  OrbOptions options;
  options.fast_adaptive = true;
  return options;
}

TEST(AdaptiveThreshold, FramesWithEnoughCornersKeepTheirBits) {
  const cv::Mat image = test::textureImage(Size(640, 480), 6);
  const Features usual = test::featuresOf(image, {});
  ASSERT_GE(4 * usual.size(), 2000U);
  expectEqual(test::featuresOf(image, adaptive()), usual, "with a texture");
}

/// Squares with hardly any contrast, blurred, as ground just below a camera.
cv::Mat faintSquares(int contrast) {
  cv::Mat image(480, 640, CV_8U, cv::Scalar(100));
  cv::RNG random(3);
  for (int i = 0; i < 60; ++i) {
    const cv::Point corner(random.uniform(0, 600), random.uniform(0, 440));
    cv::rectangle(image, cv::Rect(corner, Size(40, 40)), 100 + random.uniform(-contrast, contrast),
                  cv::FILLED);
  }
  cv::GaussianBlur(image, image, {}, 2.0);
  return image;
}

TEST(AdaptiveThreshold, BlurredSquaresHaveCorners) {
  for (const auto distribution : {KeypointDistribution::ranked, KeypointDistribution::uniform}) {
    OrbOptions usual, wanted = adaptive();
    usual.distribution = wanted.distribution = distribution;
    const std::size_t few = test::featuresOf(faintSquares(40), usual).size();
    const std::size_t more = test::featuresOf(faintSquares(40), wanted).size();
    std::printf("%zu keypoints, %zu with the adaptive threshold\n", few, more);
    EXPECT_LT(few, 500U);
    EXPECT_GT(2 * more, 3 * few);  // a uniform distribution begins at half of the threshold
    wanted.threads = 4;
    EXPECT_EQ(test::featuresOf(faintSquares(40), wanted).size(), more);
  }
}

TEST(AdaptiveThreshold, TheNextFrameBeginsWithTheFullOne) {
  OrbExtractor extractor(adaptive());
  const cv::Mat image = test::textureImage(Size(640, 480), 6);
  Features features;
  extractor.extract(faintSquares(40), features);
  extractor.extract(image, features);
  expectEqual(features, test::featuresOf(image, {}), "after a faint frame");
}

/// Corners below five grey values are noise.
TEST(AdaptiveThreshold, NoiseHasNoCorners) {
  cv::Mat image(480, 640, CV_8U, cv::Scalar(100));
  EXPECT_TRUE(test::featuresOf(image, adaptive()).empty());
  cv::RNG random(4);
  cv::Mat noise(image.size(), CV_8S);
  random.fill(noise, cv::RNG::UNIFORM, -2, 3);
  cv::add(image, noise, image, cv::noArray(), CV_8U);
  EXPECT_TRUE(test::featuresOf(image, adaptive()).empty());
}

// The right half of the image has less contrast than the left.
cv::Mat halfFaint(const Size& size) {
  cv::Mat image = test::textureImage(size, 5);
  cv::Mat faint = image.colRange(size.width / 2, size.width);
  faint.convertTo(faint, CV_8U, 0.6, 50);
  return image;
}

OrbOptions uniform(int features = 1000, int threads = 1) {
  OrbOptions options;
  options.max_features = features;
  options.distribution = KeypointDistribution::uniform;
  options.threads = threads;
  return options;
}

TEST(UniformDistribution, FillsTheFaintHalfOfAnImage) {
  const cv::Mat image = halfFaint(Size(640, 480));
  const auto share_of_faint = [&](const Features& features) {
    const auto faint = std::count_if(features.keypoints.begin(), features.keypoints.end(),
                                     [](const cv::KeyPoint& k) { return k.pt.x > 320; });
    return static_cast<double>(faint) / static_cast<double>(features.size());
  };
  OrbOptions ranked = uniform();
  ranked.distribution = KeypointDistribution::ranked;
  EXPECT_LT(share_of_faint(test::featuresOf(image, ranked)), 0.2);
  EXPECT_GT(share_of_faint(test::featuresOf(image, uniform())), 0.35);
}

TEST(UniformDistribution, KeepsExactlyAsManyAsWantedWhereTheImageHasThem) {
  const cv::Mat image = test::textureImage(Size(640, 480), 6);
  for (int features : {1, 100, 777, 2000}) {
    const Features result = test::featuresOf(image, uniform(features));
    EXPECT_EQ(static_cast<int>(result.size()), features);
  }
}

TEST(UniformDistribution, SameForAnyThreadsAndInstructionSet) {
  const cv::Mat image = halfFaint(Size(403, 301));
  const Features expected = test::featuresOf(image, uniform());
  const auto expect_same = [&](const Features& actual) {
    ASSERT_EQ(actual.size(), expected.size());
    for (std::size_t i = 0; i < actual.size(); ++i) {
      ASSERT_EQ(actual.keypoints[i].pt, expected.keypoints[i].pt);
      ASSERT_EQ(actual.keypoints[i].response, expected.keypoints[i].response);
    }
    EXPECT_EQ(cv::norm(actual.descriptors, expected.descriptors, cv::NORM_INF), 0.0);
  };
  for (int threads = 2; threads <= 8; ++threads) {
    expect_same(test::featuresOf(image, uniform(1000, threads)));
  }
  for (const OrbKernels* kernels : test::everyKernels(bestOrbKernels, portableOrbKernels())) {
    Features features;
    OrbPipeline(uniform(), *kernels).extract(image, cv::Mat(), features);
    expect_same(features);
  }
}

TEST(UniformDistribution, DescribesEachKeypointAsOpencvWould) {
  const cv::Mat image = test::textureImage(Size(500, 400), 7);
  const Features features = test::featuresOf(image, uniform());
  std::vector<cv::KeyPoint> keypoints = features.keypoints;
  cv::Mat expected;
  cv::ORB::create(1000, 1.2f, 8, 31, 0, 2, cv::ORB::HARRIS_SCORE, 31, 20)
      ->compute(image, keypoints, expected);
  ASSERT_EQ(keypoints.size(), features.size());
  EXPECT_EQ(cv::norm(features.descriptors, expected, cv::NORM_INF), 0.0);
}

TEST(UniformDistribution, RespectsTheMask) {
  const cv::Mat image = test::textureImage(Size(400, 300), 8);
  cv::Mat mask = cv::Mat::zeros(image.size(), CV_8U);
  mask(cv::Rect(100, 80, 200, 150)).setTo(255);
  Features features;
  OrbExtractor(uniform(2000)).extract(image, mask, features);
  EXPECT_GT(features.size(), 50u);
  for (const cv::KeyPoint& keypoint : features.keypoints) {
    EXPECT_TRUE(cv::Rect2f(96, 76, 208, 158).contains(keypoint.pt));
  }
}

TEST(UniformDistribution, FindsNothingOnAFlatImage) {
  EXPECT_TRUE(test::featuresOf(test::flatImage(Size(300, 200), 9), uniform()).empty());
}

}  // namespace
}  // namespace ktgp_orb::orb
