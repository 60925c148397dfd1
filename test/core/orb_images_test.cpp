#include <gtest/gtest.h>

#include "ktgp_orb/orb_extractor.h"
#include "orb_test_images.h"

namespace ktgp_orb {
namespace {

OrbOptions keepingImages(ExtractorKind kind) {
  OrbOptions options;
  options.extractor = kind;
  options.images = ImageKeeping::share;
  return options;
}

TEST(OrbImages, DoNotComeWhereNotWanted) {
  Features features;
  OrbExtractor(keepingImages(ExtractorKind::native))
      .extract(test::textureImage(cv::Size(320, 240), 1), features);
  EXPECT_FALSE(features.images.empty());
  OrbOptions options;
  options.images = ImageKeeping::none;
  OrbExtractor(options).extract(test::textureImage(cv::Size(320, 240), 1), features);
  EXPECT_TRUE(features.images.empty());
}

TEST(OrbImages, BeginWithTheImageItselfAndAreTheSameForBothExtractors) {
  const cv::Mat image = test::textureImage(cv::Size(320, 240), 2);
  Features fast;
  Features opencv;
  OrbExtractor(keepingImages(ExtractorKind::native)).extract(image, fast);
  OrbExtractor(keepingImages(ExtractorKind::opencv)).extract(image, opencv);
  EXPECT_EQ(fast.images[0].data, image.data);
  EXPECT_EQ(opencv.images[0].data, image.data);
  ASSERT_EQ(fast.images.size(), 8u);
  ASSERT_EQ(opencv.images.size(), 8u);
  for (std::size_t i = 0; i < fast.images.size(); ++i) {
    ASSERT_EQ(fast.images[i].size(), opencv.images[i].size());
    EXPECT_EQ(cv::norm(fast.images[i], opencv.images[i], cv::NORM_INF), 0.0);
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
  for (ExtractorKind kind : {ExtractorKind::native, ExtractorKind::opencv}) {
    OrbExtractor extractor(keepingImages(kind));
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
}

TEST(OrbImages, MoveNoMoreOnceTwoFramesHaveTheirs) {
  const cv::Mat images[] = {test::textureImage(cv::Size(320, 240), 6),
                            test::textureImage(cv::Size(320, 240), 7)};
  OrbExtractor extractor(keepingImages(ExtractorKind::native));
  Features frames[2];
  const auto extract = [&](int i) { extractor.extract(images[i % 2], frames[i % 2]); };
  for (int i = 0; i < 4; ++i) extract(i);
  const std::uint8_t* pixels[] = {frames[0].images[1].data, frames[1].images[1].data};
  for (int i = 0; i < 6; ++i) extract(i);
  EXPECT_EQ(frames[0].images[1].data, pixels[0]);
  EXPECT_EQ(frames[1].images[1].data, pixels[1]);
}

}  // namespace
}  // namespace ktgp_orb
