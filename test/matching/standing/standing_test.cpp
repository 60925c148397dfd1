// Things that stand still in the image, such as hot pixels and dirt, while the scene moves; and a
// scene that stands still behind something that moves.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <random>
#include <vector>

#include "frame_pair.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "orb_test_images.h"

namespace ktgp_orb {
namespace {

Features manyFeatures(const cv::Mat& image, int number) {
  OrbOptions options;
  options.max_features = number;
  return test::featuresOf(image, options);
}

/// Spots of a sky, moved by `shift` px, and pixels of the sensor that are always bright.
cv::Mat skyWith(int stars, int hot, const cv::Point2d& shift, unsigned seed) {
  std::mt19937 sky(5);
  std::mt19937 sensor(seed);
  cv::Mat image(600, 800, CV_8UC1);
  std::normal_distribution<double> noise(12.0, 2.5);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      image.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(noise(sensor));
    }
  }
  std::uniform_real_distribution<double> in_x(20.0, 780.0), in_y(20.0, 580.0), bright(60.0, 240.0);
  for (int i = 0; i < stars; ++i) {
    const cv::Point2d at = cv::Point2d(in_x(sky), in_y(sky)) + shift;
    const double light = bright(sky);
    for (int y = cvRound(at.y) - 5; y <= cvRound(at.y) + 5; ++y) {
      for (int x = cvRound(at.x) - 5; x <= cvRound(at.x) + 5; ++x) {
        if (!cv::Rect({}, image.size()).contains({x, y})) continue;
        const double square = (x - at.x) * (x - at.x) + (y - at.y) * (y - at.y);
        auto& pixel = image.at<std::uint8_t>(y, x);
        pixel = cv::saturate_cast<std::uint8_t>(pixel + light * std::exp(-square / 2.5));
      }
    }
  }
  std::mt19937 flaws(9);
  for (int i = 0; i < hot; ++i) {
    const cv::Point at(cvRound(in_x(flaws)), cvRound(in_y(flaws)));
    image.at<std::uint8_t>(at) = static_cast<std::uint8_t>(bright(flaws));
  }
  return image;
}

// Hot pixels agree that nothing moves, and may be more than the stars.
TEST(KtgpMatcher, HotPixelsAreNotTakenForTheSky) {
  const cv::Point2d shifts[] = {{4.3, -1.7}, {-2.6, 3.1}, {11.0, 6.0}, {0.0, 30.0}};
  int found = 0;
  for (const int hot : {60, 500, 900}) {
    for (const cv::Point2d& shift : shifts) {
      KtgpMatcher matcher(MatcherOptions::robust());
      MatchResult result;
      matcher.match(manyFeatures(skyWith(450, hot, {}, 1), 5000),
                    manyFeatures(skyWith(450, hot, shift, 2), 5000), result);
      if (result.status != Status::ok) continue;
      ++found;
      const Eigen::Vector2d centre(400.0, 300.0);
      const Eigen::Vector2d moved =
          (result.answer.homography * centre.homogeneous()).hnormalized() - centre;
      EXPECT_NEAR(moved.x(), shift.x, 1.0) << hot << " hot pixels";
      EXPECT_NEAR(moved.y(), shift.y, 1.0) << hot << " hot pixels";
    }
  }
  EXPECT_GE(found, 10) << "of 12";
}

using Spots = std::vector<cv::Rect>;
const Spots kClean, kSmallSpots{{20, 20, 180, 70}, {420, 300, 150, 90}},
    kLargeSpots{{366, 50, 256, 181}, {75, 258, 255, 143}};

/// A ground that a camera flies over, `x` px from its left border, seen through a lens with dirt.
cv::Mat viewThroughLens(int x, const Spots& spots) {
  const cv::Mat ground = test::textureImage(cv::Size(900, 500), 4);
  const cv::Mat flaws = test::textureImage(cv::Size(640, 480), 8);
  cv::Mat image = ground(cv::Rect(x, 10, 640, 480)).clone();
  for (const cv::Rect& spot : spots) flaws(spot).copyTo(image(spot));
  return image;
}

// A dirty lens, or text that a recorder burns in: most of the picture moves.
TEST(KtgpMatcher, ThingsThatStandStillInAMovingPictureAreCounted) {
  for (const bool is_dirty : {false, true}) {
    KtgpMatcher matcher;
    MatchResult result;
    const Spots& spots = is_dirty ? kSmallSpots : kClean;
    matcher.match(manyFeatures(viewThroughLens(0, spots), 2000),
                  manyFeatures(viewThroughLens(9, spots), 2000), result);
    ASSERT_EQ(result.status, Status::ok);
    EXPECT_NEAR(result.answer.homography(0, 2), -9.0, 0.5);
    EXPECT_EQ(result.hasStillThings(), is_dirty) << result.still;
  }
}

// The homography of all matches is a mixture of both motions, 5 to 9 px off in a corner.
TEST(KtgpMatcher, ThingsThatStandStillDoNotBendAMotionOfAFewPixels) {
  for (const MatcherOptions& options : {MatcherOptions::ktgp(), MatcherOptions::robust()}) {
    for (const int way : {4, 5, 6}) {
      KtgpMatcher matcher(options);
      MatchResult result;
      matcher.match(manyFeatures(viewThroughLens(0, kLargeSpots), 2000),
                    manyFeatures(viewThroughLens(way, kLargeSpots), 2000), result);
      ASSERT_EQ(result.status, Status::ok);
      const Eigen::Matrix3d truth = test::translation(-way, 0.0);
      EXPECT_LT(test::cornerError(result.answer.homography, truth, {640, 480}), 0.5) << way;
      EXPECT_TRUE(result.hasStillThings()) << result.still;
    }
  }
}

// Something that moves in front of a camera that stands still.
TEST(KtgpMatcher, PassingThingsDoNotMoveAStandingCamera) {
  const cv::Mat wall = test::textureImage(cv::Size(640, 480), 4);
  const cv::Mat lorry = test::textureImage(cv::Size(300, 220), 8);
  const auto view = [&](int x) {
    cv::Mat image = wall.clone();
    lorry.copyTo(image(cv::Rect(100 + x, 200, lorry.cols, lorry.rows)));
    return image;
  };
  KtgpMatcher matcher;
  MatchResult result;
  matcher.match(manyFeatures(view(0), 2000), manyFeatures(view(9), 2000), result);
  ASSERT_EQ(result.status, Status::ok);
  EXPECT_LT((result.answer.homography - Eigen::Matrix3d::Identity()).norm(), 0.5);
  EXPECT_EQ(result.still, 0U);
}

// A river in the lower part of a wide image.
TEST(KtgpMatcher, ABandThatMovesDoesNotMoveAStandingCamera) {
  const cv::Mat bank = test::textureImage(cv::Size(1280, 480), 4);
  const cv::Mat river = test::textureImage(cv::Size(1400, 200), 8);
  const auto view = [&](int x) {
    cv::Mat image = bank.clone();
    river(cv::Rect(x, 0, 1280, 200)).copyTo(image(cv::Rect(0, 280, 1280, 200)));
    return image;
  };
  KtgpMatcher matcher;
  MatchResult result;
  matcher.match(manyFeatures(view(0), 3000), manyFeatures(view(60), 3000), result);
  ASSERT_EQ(result.status, Status::ok);
  EXPECT_LT((result.answer.homography - Eigen::Matrix3d::Identity()).norm(), 0.5);
}

}  // namespace
}  // namespace ktgp_orb
