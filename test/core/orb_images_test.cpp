#include <gtest/gtest.h>

#include "ktgp_orb/orb_extractor.h"
#include "orb_test_images.h"

namespace ktgp_orb {
namespace {

OrbOptions sharingImages() {
  OrbOptions options;
  options.images = ImageKeeping::share;
  return options;
}

TEST(OrbImages, DoNotComeWhereNotWanted) {
  Features features;
  OrbExtractor(sharingImages()).extract(test::textureImage(cv::Size(320, 240), 1), features);
  EXPECT_FALSE(features.images.empty());
  OrbOptions options;
  options.images = ImageKeeping::none;
  OrbExtractor(options).extract(test::textureImage(cv::Size(320, 240), 1), features);
  EXPECT_TRUE(features.images.empty());
}

TEST(OrbImages, AreTheImageItselfAndLevelsOfTheWantedRatio) {
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

TEST(OrbImages, AreTheSameWithLevelsLargerThanTheImage) {
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

TEST(OrbImages, MoveNoMoreOnceTwoFramesHaveTheirs) {
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

TEST(OrbExtractor, LeavesDescriptorsAloneThatSomebodyElseHolds) {
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
