// Many flat targets: drawn posters in rendered frames with known homographies.
#include "ktgp_orb/target_finder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "orb_test_images.h"
#include "target_world.h"

namespace ktgp_orb {
namespace {

using test::Placement;

const cv::Size kFrame(640, 480);
const cv::Size kPoster(300, 220);

Target poster(int number) {
  Target target;
  target.id = "poster" + std::to_string(number);
  target.images = {test::drawnPicture(kPoster, static_cast<std::uint64_t>(number))};
  return target;
}

TargetFinder finderOf(int posters, TargetFinderOptions options = {}) {
  TargetFinder finder(options);
  for (int i = 0; i < posters; ++i) finder.add(poster(i));
  return finder;
}

struct Shown {
  int number;
  Eigen::Matrix3d homography;
};

Shown shown(int number, double x, double y, double tilt = 0.4, double zoom = 0.7,
            double turn = 0.3) {
  Placement p;
  p.tilt = tilt;
  p.axis = 1.0 + number;
  p.turn = turn;
  p.zoom = zoom;
  p.middle = {x, y};
  return {number, test::homographyOf(p, kPoster)};
}

cv::Mat frameOf(const std::vector<Shown>& all, std::uint64_t background = 1000) {
  cv::Mat frame, image;
  test::drawnPicture(kFrame, background).convertTo(frame, CV_32F);
  for (const Shown& one : all) {
    test::place(poster(one.number).images[0], one.homography, frame);
  }
  frame.convertTo(image, CV_8U);
  return image;
}

const DetectedTarget* detectionOf(const TargetFrame& frame, int number) {
  for (const DetectedTarget& d : frame.detections) {
    if (d.id == poster(number).id && d.status == Status::ok) return &d;
  }
  return nullptr;
}

double errorOf(const DetectedTarget& detection, const Shown& truth) {
  return test::errorInView(truth.homography, detection.homography.homography, kPoster, kFrame);
}

std::string reasonOf(TargetFinder& finder, const Target& target) {
  try {
    finder.add(target);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(TargetFinder, FindsEachTargetAndNoOther) {
  TargetFinder finder = finderOf(12);
  for (int n = 0; n < 12; n += 2) {
    const std::vector<Shown> truth{shown(n, 170, 240), shown((n + 3) % 12, 470, 240, 0.7)};
    const TargetFrame& frame = finder.find(frameOf(truth, 2000 + static_cast<std::uint64_t>(n)));
    ASSERT_EQ(frame.detections.size(), truth.size()) << n;
    for (const Shown& one : truth) {
      const DetectedTarget* found = detectionOf(frame, one.number);
      ASSERT_NE(found, nullptr) << one.number;
      EXPECT_LT(errorOf(*found, one), 0.5);
      EXPECT_GT(found->inliers, 12U);
    }
    finder.restart();
  }
}

TEST(TargetFinder, CornersAreWhereTheHomographyAndItsCovarianceSay) {
  TargetFinder finder = finderOf(3);
  double squares = 0.0;
  std::size_t count = 0, right = 0;
  for (const double zoom : {0.4, 0.6, 1.0}) {
    for (const double tilt : {0.0, 0.4, 0.75}) {
      const Shown truth = shown(1, 320, 240, tilt, zoom);
      const TargetFrame& frame = finder.find(frameOf({truth}));
      const DetectedTarget* found = detectionOf(frame, 1);
      ASSERT_NE(found, nullptr);
      EXPECT_TRUE(found->aligned);
      EXPECT_EQ(found->image_size, kPoster);
      std::size_t i = 0;
      for (const Eigen::Vector2d& corner : test::corners(kPoster)) {
        const Eigen::Vector2d error =
            found->corners[i] -
            Eigen::Vector2d((truth.homography * corner.homogeneous()).hnormalized());
        const Eigen::Matrix2d covariance = found->corner_covariances[i++];
        squares += error.squaredNorm();
        right += error.dot(covariance.inverse() * error) < 13.8 ? 1 : 0;  // 99.9 %
        ++count;
      }
    }
  }
  EXPECT_LT(std::sqrt(squares / static_cast<double>(count)), 0.05);  // px
  EXPECT_EQ(right, count);
}

TEST(TargetFinder, AnEmptySceneHasNoTarget) {
  TargetFinder finder = finderOf(12);
  for (std::uint64_t i = 0; i < 10; ++i) {
    EXPECT_TRUE(finder.find(frameOf({}, 3000 + i)).detections.empty()) << i;
  }
  EXPECT_TRUE(finder.find(test::flatImage(kFrame, 90)).detections.empty());
  EXPECT_TRUE(TargetFinder().find(frameOf({})).detections.empty());
}

TEST(TargetFinder, InstancesKeepTheirNumbers) {
  TargetFinder finder = finderOf(4);
  const auto at = [](int step) {
    return std::vector<Shown>{shown(2, 150.0 + 6 * step, 130, 0.2, 0.6),
                              shown(2, 490.0 - 6 * step, 350, 0.2, 0.6)};
  };
  int first = -1;
  for (int step = 0; step < 5; ++step) {
    const std::vector<Shown> truth = at(step);
    const TargetFrame& frame = finder.find(frameOf(truth));
    ASSERT_EQ(frame.detections.size(), 2U) << step;
    if (step == 0) first = errorOf(frame.detections[0], truth[0]) < 3.0 ? 0 : 1;
    for (const DetectedTarget& d : frame.detections) {
      EXPECT_EQ(d.age, step + 1);
      const std::size_t place = d.instance == first ? 0 : 1;
      EXPECT_LT(errorOf(d, truth[place]), 1.0) << step;
    }
  }
}

TEST(TargetFinder, CopiesSideBySideAreTwoInstances) {
  TargetFinder finder = finderOf(2);
  const TargetFrame& frame =
      finder.find(frameOf({shown(1, 200, 240, 0.0, 0.5, 0.0), shown(1, 352, 240, 0.0, 0.5, 0.0)}));
  EXPECT_EQ(frame.detections.size(), 2U);
}

TEST(TargetFinder, TargetsThatOverlapAreFound) {
  TargetFinder finder = finderOf(6);
  const std::vector<Shown> truth{shown(0, 280, 230, 0.3, 1.2), shown(3, 390, 300, 0.3, 0.7)};
  const TargetFrame& frame = finder.find(frameOf(truth));
  for (const Shown& one : truth) {
    const DetectedTarget* found = detectionOf(frame, one.number);
    ASSERT_NE(found, nullptr) << one.number;
    EXPECT_LT(errorOf(*found, one), 1.0);
  }
}

TEST(TargetFinder, RefusesWhatCannotBeATarget) {
  TargetFinder finder = finderOf(1);
  Target target = poster(0);
  EXPECT_NE(reasonOf(finder, target).find("exists already"), std::string::npos);
  target.id = "";
  EXPECT_NE(reasonOf(finder, target).find("no id"), std::string::npos);
  target.id = "a";
  EXPECT_NE(reasonOf(finder, target).find("shows the same as target \"poster0\""),
            std::string::npos);
  target.images = {};
  EXPECT_NE(reasonOf(finder, target).find("no image"), std::string::npos);
  target.images = {cv::Mat()};
  EXPECT_NE(reasonOf(finder, target).find("is empty"), std::string::npos);
  target.images = {cv::Mat(100, 100, CV_8UC3)};
  EXPECT_NE(reasonOf(finder, target).find("not 8-bit grey"), std::string::npos);
  target.images = {test::flatImage(kPoster, 100)};
  EXPECT_NE(reasonOf(finder, target).find("too little texture"), std::string::npos);
  target = poster(1);
  target.width = -1.0;
  EXPECT_NE(reasonOf(finder, target).find("width"), std::string::npos);
  target.width = NAN;
  EXPECT_NE(reasonOf(finder, target).find("width"), std::string::npos);
  EXPECT_EQ(finder.ids(), std::vector<std::string>{"poster0"});
  EXPECT_THROW(finder.replace(poster(7)), std::invalid_argument);
  EXPECT_THROW(finder.find(cv::Mat(10, 10, CV_16U)), std::invalid_argument);
  TargetFinderOptions options;
  options.views = 3;
  EXPECT_THROW(TargetFinder{options}, std::invalid_argument);
}

/// Adds `picture` and then a thousand of its copies, which must all be refused.
template <typename Copy>
void expectOneTarget(const cv::Mat& picture, const Copy& copyOf) {
  TargetFinder finder;
  Target target;
  target.id = "first";
  target.images = {picture};
  finder.add(target);
  constexpr int kCopies = 1000;
  int refused = 0;
  for (int i = 0; i < kCopies; ++i) {
    target.id = "copy" + std::to_string(i);
    target.images = {copyOf(i)};
    const std::string reason = reasonOf(finder, target);
    refused += reason.find("shows the same as target \"first\"; they could not be told apart") !=
                       std::string::npos
                   ? 1
                   : 0;
  }
  EXPECT_EQ(refused, kCopies);
  EXPECT_EQ(finder.ids(), std::vector<std::string>{"first"});
  const TargetFrame& frame = finder.find(picture);
  ASSERT_EQ(frame.detections.size(), 1U);
  EXPECT_EQ(frame.detections[0].status, Status::ok);
}

TEST(TargetFinder, AThousandTimesTheSamePictureIsOneTarget) {
  const cv::Mat picture = test::drawnPicture({160, 120}, 1);
  expectOneTarget(picture, [&](int) { return picture; });
}

TEST(TargetFinder, AThousandSlightlyDifferentCopiesAreOneTarget) {
  const cv::Mat picture = test::drawnPicture({160, 120}, 1);
  expectOneTarget(picture, [&](int i) {
    cv::Mat copy = picture(cv::Rect(i % 3, i / 3 % 3, 158, 118)).clone();
    const double scale = 1.0 + 0.0005 * i;
    if (i % 2 == 1) cv::resize(copy, copy, cv::Size(), scale, scale);
    std::vector<std::uint8_t> jpeg;
    cv::imencode(".jpg", copy, jpeg, {cv::IMWRITE_JPEG_QUALITY, 30 + i % 70});
    return cv::imdecode(jpeg, cv::IMREAD_GRAYSCALE);
  });
}

TEST(TargetFinder, PostersWithTheSameLogoAreTwoTargets) {
  TargetFinder finder;
  Target other = poster(1);
  const cv::Rect logo(0, 0, kPoster.width * 9 / 20, kPoster.height);
  poster(0).images[0](logo).copyTo(other.images[0](logo));
  finder.add(poster(0));
  EXPECT_EQ(reasonOf(finder, other), "");
}

TEST(TargetFinder, APictureWithTextureInItsMiddleIsTheSameAsItsCopy) {
  cv::Mat sparse(3 * kPoster.height, 3 * kPoster.width, CV_8U, cv::Scalar(128));
  poster(0).images[0].copyTo(sparse(cv::Rect(cv::Point(kPoster), kPoster)));
  Target target;
  target.id = "sparse";
  target.images = {sparse};
  Target copy = target;
  copy.id = "copy";
  TargetFinder finder;
  finder.add(target);
  EXPECT_NE(reasonOf(finder, copy).find("shows the same as target \"sparse\""), std::string::npos);
}

TEST(TargetFinder, ForgetsRemovedTargetsAndFindsReplacedOnes) {
  TargetFinder finder = finderOf(5);
  const cv::Mat frame = frameOf({shown(1, 170, 240), shown(3, 470, 240)});
  EXPECT_EQ(finder.find(frame).detections.size(), 2U);
  EXPECT_TRUE(finder.remove("poster1"));
  EXPECT_FALSE(finder.remove("poster1"));
  EXPECT_EQ(finder.find(frame).detections.size(), 1U);
  Target other = poster(1);
  other.id = "poster3";
  finder.replace(other);
  const TargetFrame& after = finder.find(frame);
  ASSERT_EQ(after.detections.size(), 1U);
  EXPECT_EQ(after.detections[0].id, "poster3");
  EXPECT_LT(errorOf(after.detections[0], shown(1, 170, 240)), 1.0);
}

TEST(TargetFinder, KnowsATargetByEachOfItsImages) {
  TargetFinder finder;
  Target target = poster(0);
  target.images.push_back(poster(1).images[0]);
  target.width = 0.5;
  target.frame = "door";
  finder.add(target);
  finder.add(poster(2));
  const TargetFrame& frame = finder.find(frameOf({shown(1, 320, 240)}));
  ASSERT_EQ(frame.detections.size(), 1U);
  EXPECT_EQ(frame.detections[0].id, "poster0");
  EXPECT_EQ(frame.detections[0].image, 1U);
  EXPECT_EQ(frame.detections[0].width, 0.5);
  EXPECT_EQ(frame.detections[0].frame, "door");
}

/// Equal to the last bit.
void expectSame(const DetectedTarget& a, const DetectedTarget& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.inliers, b.inliers);
  EXPECT_EQ(a.homography.homography, b.homography.homography);
  EXPECT_EQ(a.homography.covariance, b.homography.covariance);
}

/// With a tilt of 55 to 65 degrees and noise, few keypoints are found again.
TEST(TargetFinder, SteepTargetsGrowFromTheGreyValues) {
  const cv::Size size(240, 180);
  int found = 0;
  for (const int number : {1, 17, 19, 22, 36, 38}) {
    TargetFinder finder;
    Target target;
    target.id = "steep";
    target.images = {test::drawnPicture(size, static_cast<std::uint64_t>(number))};
    finder.add(target);
    cv::RNG rng(static_cast<std::uint64_t>(number));
    test::Placement p;
    p.tilt = rng.uniform(0.95, 1.15);
    p.zoom = rng.uniform(0.5, 0.8);
    p.turn = rng.uniform(-3.0, 3.0);
    p.axis = rng.uniform(0.0, 6.2);
    const Eigen::Matrix3d truth = test::homographyOf(p, size);
    cv::Mat frame, noise(kFrame, CV_32F), image;
    test::drawnPicture(kFrame, 900U + static_cast<unsigned>(number) % 5U).convertTo(frame, CV_32F);
    test::place(target.images[0], truth, frame);
    rng.fill(noise, cv::RNG::NORMAL, 0.0, 7.0);
    cv::Mat(frame + noise).convertTo(image, CV_8U);
    for (const DetectedTarget& one : finder.find(image).detections) {
      found += one.status == Status::ok ? 1 : 0;
      EXPECT_LT(test::errorInView(truth, one.homography.homography, size, kFrame), 5.0) << number;
    }
  }
  EXPECT_GE(found, 5);
}

/// Only the corners of the target are in the frame. Their keypoints alone would be enough evidence.
TEST(TargetFinder, WhatLooksDifferentInMostPartsIsNotFound) {
  TargetFinder finder;
  Target target;
  target.id = "poster";
  target.images = {test::drawnPicture({360, 270}, 9)};
  finder.add(target);
  cv::Mat whole;
  cv::resize(target.images[0], whole, cv::Size(576, 432));
  const auto detectionsWith = [&](int width, int height) {
    cv::Mat frame = test::drawnPicture(kFrame, 905);
    for (const int x : {0, whole.cols - width}) {
      for (const int y : {0, whole.rows - height}) {
        const cv::Rect corner(x, y, width, height);
        whole(corner).copyTo(frame(corner + cv::Point(20, 20)));
      }
    }
    finder.restart();
    return finder.find(frame).detections.size();
  };
  EXPECT_EQ(detectionsWith(138, 103), 0U);  // 23 % of its area
  EXPECT_EQ(detectionsWith(195, 146), 1U);  // 46 %
}

TEST(TargetFinder, TheBudgetDecidesWhatIsTriedNotWhatIsFound) {
  TargetFinderOptions options;
  TargetFinder all = finderOf(16, options);
  options.search_ms = 0.0;  // one target on each frame, in turn
  TargetFinder few = finderOf(16, options);
  const cv::Mat image = frameOf({shown(4, 170, 240), shown(11, 470, 240)});
  const std::vector<DetectedTarget> expected = all.find(image).detections;
  ASSERT_EQ(expected.size(), 2U);
  EXPECT_EQ(all.find(image).search.frames_for_all, 1U);
  const std::size_t bound = few.find(image).search.frames_for_all;
  EXPECT_GT(bound, 1U);
  few.restart();
  std::size_t seen = 0;
  for (std::size_t i = 0; i < bound; ++i) {
    const TargetFrame& frame = few.find(image);
    for (const DetectedTarget& d : frame.detections) {
      expectSame(d, d.id == expected[0].id ? expected[0] : expected[1]);
    }
    seen = std::max(seen, frame.detections.size());
  }
  EXPECT_EQ(seen, 2U);
}

TEST(TargetFinder, WhatIsFollowedDoesNotWaitForTheBudget) {
  TargetFinder finder = finderOf(16);
  const std::vector<Shown> truth{shown(4, 170, 240), shown(11, 470, 240)};
  const cv::Mat image = frameOf(truth);
  const std::vector<DetectedTarget> expected = finder.find(image).detections;
  ASSERT_EQ(expected.size(), 2U);
  finder.setSearch(0.0, 48.0);
  for (int age = 2; age < 6; ++age) {
    const TargetFrame& frame = finder.find(image);
    ASSERT_EQ(frame.detections.size(), 2U);
    for (std::size_t i = 0; i < 2; ++i) {
      expectSame(frame.detections[i], expected[i]);
      EXPECT_EQ(frame.detections[i].age, age);
    }
    EXPECT_GT(frame.search.frames_for_all, 5U);  // 128 of the 3000 keypoints on each frame
  }
}

TEST(TargetFinder, OtherTargetsChangeNothing) {
  TargetFinder few = finderOf(8);
  TargetFinder many = finderOf(16);
  const cv::Mat image = frameOf({shown(4, 170, 240), shown(6, 470, 240)});
  const std::vector<DetectedTarget> expected = few.find(image).detections;
  const TargetFrame& frame = many.find(image);
  ASSERT_EQ(expected.size(), 2U);
  ASSERT_EQ(frame.detections.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) expectSame(frame.detections[i], expected[i]);
}

TEST(TargetFinder, TheSameFramesGiveTheSameBits) {
  std::vector<DetectedTarget> first;
  for (int run = 0; run < 2; ++run) {
    TargetFinder finder = finderOf(8);
    const TargetFrame& frame = finder.find(frameOf({shown(4, 170, 240), shown(6, 470, 240)}));
    if (run == 0) first = frame.detections;
    ASSERT_EQ(frame.detections.size(), first.size());
    for (std::size_t i = 0; i < first.size(); ++i) expectSame(frame.detections[i], first[i]);
  }
}

TEST(TargetFinder, AnImageAloneChangesNothing) {
  TargetFinder finder = finderOf(4);
  finder.setSearch(0.0, 48.0);
  EXPECT_THROW(finder.setSearch(-1.0, 48.0), std::invalid_argument);
  const cv::Mat image = frameOf({shown(2, 200, 240)});
  while (finder.find(image).detections.empty()) {
  }
  const int age = finder.find(image).detections[0].age;
  EXPECT_EQ(finder.findAlone(frameOf({shown(1, 200, 240), shown(3, 480, 240)})).detections.size(),
            2U);
  EXPECT_EQ(finder.find(image).detections.at(0).age, age + 1);
}

TEST(TargetFinder, TakesFramesOfAnotherSizeAndFeatures) {
  TargetFinder finder = finderOf(3);
  const Shown truth = shown(1, 320, 240);
  cv::Mat image = frameOf({truth});
  EXPECT_EQ(finder.find(image).detections.size(), 1U);
  cv::Mat larger;
  cv::copyMakeBorder(image, larger, 0, 100, 0, 200, cv::BORDER_CONSTANT, 80);
  for (const cv::Mat& frame : {larger, image, larger}) {
    const TargetFrame& found = finder.find(frame);
    ASSERT_EQ(found.detections.size(), 1U);
    EXPECT_LT(errorOf(found.detections[0], truth), 0.5);
  }
  Features features;
  OrbExtractor(finder.options().orb).extract(image, features);
  EXPECT_EQ(finder.find(features).detections.size(), 1U);
  features.descriptor = DescriptorKind::teblid;
  EXPECT_THROW(finder.find(features), std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb
