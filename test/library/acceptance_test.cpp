// The claims of the README on every machine: on drawn images with exact truth, and on the
// photographs of Debian's opencv-doc. Each result is compared with the truth, with a naive
// implementation or with OpenCV's.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "alignment_scene.h"
#include "dense_gms.h"
#include "frame_pair.h"
#include "ktgp_orb/metrics.h"
#include "orb_test_images.h"
#include "plain_search.h"
#include "test_data.h"

namespace ktgp_orb {
namespace {

const cv::Size kSize(640, 480);

/// A picture and a second view of it.
struct Pair {
  std::string name;
  cv::Mat reference, target;
  Eigen::Matrix3d truth = Eigen::Matrix3d::Identity();  ///< reference to target
};

/// Two views of a picture, the second one moved, blurred, darker and with noise.
Pair viewsOf(const std::string& name, const cv::Mat& picture, const Eigen::Matrix3d& truth) {
  Pair pair;
  pair.name = name;
  pair.truth = truth;
  cv::GaussianBlur(picture, pair.reference, {}, 1.0);
  cv::Mat moved = test::warped(pair.reference, truth, kSize), noise(kSize, CV_32F);
  cv::RNG(1).fill(noise, cv::RNG::NORMAL, 0.0, 2.0);
  moved.convertTo(moved, CV_32F, 0.8, 5.0);
  cv::Mat(moved + noise).convertTo(pair.target, CV_8U);
  return pair;
}

std::vector<Pair> viewsOf(const std::string& name, const cv::Mat& picture) {
  return {viewsOf(name + ", shifted", picture, test::turn(2.0, 1.0, {1e-5, 0.0})),
          viewsOf(name + ", turned and nearer", picture, test::turn(8.0, 1.15, {-5e-5, 0.0})),
          viewsOf(name + ", oblique", picture, test::turn(-5.0, 0.9, {2e-4, 0.0}))};
}

std::vector<cv::Mat> drawnPictures() {
  return {test::textureImage(kSize, 1), test::blockImage(kSize, 2), test::drawnPicture(kSize, 3),
          test::drawnPicture(kSize, 4)};
}

/// Files of opencv-doc; empty where it is not installed.
std::vector<cv::Mat> photographs() {
  std::vector<cv::Mat> all;
  const auto folder = test::photoFolder();
  for (const char* file : {"starry_night.jpg", "aloeL.jpg", "board.jpg", "rubberwhale1.png",
                           "home.jpg", "building.jpg"}) {
    if (!folder) break;
    const cv::Mat image = cv::imread(*folder + "/" + file, cv::IMREAD_GRAYSCALE);
    EXPECT_FALSE(image.empty()) << file;
    all.emplace_back();
    cv::resize(image, all.back(), kSize, 0.0, 0.0, cv::INTER_AREA);
  }
  return all;
}

std::vector<Pair> viewsOfAll(const std::vector<cv::Mat>& pictures) {
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    for (Pair& pair : viewsOf("picture " + std::to_string(i), pictures[i])) pairs.push_back(pair);
  }
  return pairs;
}

/// The paper's chain, without what this package adds.
MatcherOptions chainOfThePaper() {
  MatcherOptions options;
  options.alignment.enabled = false;
  return options;
}

/// KNN, TF and GMS of the paper, as simple as they can be written.
std::vector<Correspondence> naiveChain(const Features& reference, const Features& target) {
  auto all = test::plainSearch(reference.descriptors, target.descriptors, false);
  std::vector<Correspondence> kt;
  for (Correspondence& c : all) {
    if (c.second_distance == 0 || c.distance >= 0.66 * c.second_distance) continue;
    c.level = Level::kt;
    kt.push_back(c);
  }
  test::DenseGms gms{GmsOptions()};
  const auto& mask = gms.mask(reference, target, kt);
  for (std::size_t i = 0; i < kt.size(); ++i) {
    if (mask[i] != 0) all[static_cast<std::size_t>(kt[i].target_index)].level = Level::ktg;
  }
  return all;
}

/// Matches of each level are those of the naive chain, one by one; PROSAC's are those that its
/// homography explains.
void expectChainOfThePaper(const Pair& pair) {
  SCOPED_TRACE(pair.name);
  const test::FramePair frames(pair.reference, pair.target);
  const auto& [reference, target] = frames;
  const MatcherOptions options = chainOfThePaper();
  const MatchResult result = test::matched(frames, options);
  ASSERT_EQ(result.status, Status::ok);
  const std::vector<Correspondence> expected = naiveChain(reference, target);
  ASSERT_EQ(result.correspondences.size(), expected.size());
  std::size_t passed_gms = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const Correspondence& found = result.correspondences[i];
    ASSERT_EQ(found.reference_index, expected[i].reference_index) << i;
    ASSERT_EQ(found.distance, expected[i].distance) << i;
    ASSERT_EQ(found.second_distance, expected[i].second_distance) << i;
    ASSERT_EQ(std::min(found.level, Level::ktg), expected[i].level) << i;
    if (expected[i].level < Level::ktg) continue;
    ++passed_gms;
    const cv::Point2f& x = reference.keypoints[static_cast<std::size_t>(found.reference_index)].pt;
    const cv::Point2f& y = target.keypoints[i].pt;
    const double error = reprojectionError(result.answer.homography, {x.x, x.y}, {y.x, y.y});
    ASSERT_EQ(found.level == Level::ktgp, error < options.prosac.max_error) << i;
  }
  EXPECT_GT(passed_gms, 20u) << "the pair is too hard to test anything";
}

/// Mean corner error in px of the homography for these options; 1000 where there is none.
double errorOf(const Pair& pair, const MatcherOptions& options) {
  const MatchResult result = test::matched({pair.reference, pair.target}, options);
  return result.status == Status::ok
             ? test::cornerError(result.answer.homography, pair.truth, kSize)
             : 1000.0;
}

/// The same for OpenCV: ORB, brute force with the same ratio test, RANSAC.
double errorOfOpencv(const Pair& pair) {
  std::vector<cv::KeyPoint> keypoints[2];
  cv::Mat descriptors[2];
  const auto orb = cv::ORB::create(2000);
  orb->detectAndCompute(pair.reference, cv::noArray(), keypoints[0], descriptors[0]);
  orb->detectAndCompute(pair.target, cv::noArray(), keypoints[1], descriptors[1]);
  std::vector<std::vector<cv::DMatch>> neighbours;
  cv::BFMatcher(cv::NORM_HAMMING).knnMatch(descriptors[1], descriptors[0], neighbours, 2);
  std::vector<cv::Point2f> from, to;
  for (const auto& two : neighbours) {
    if (two[0].distance >= 0.66F * two[1].distance) continue;
    from.push_back(keypoints[0][static_cast<std::size_t>(two[0].trainIdx)].pt);
    to.push_back(keypoints[1][static_cast<std::size_t>(two[0].queryIdx)].pt);
  }
  if (from.size() < 4) return 1000.0;
  const cv::Mat h = cv::findHomography(from, to, cv::RANSAC, 3.0);
  if (h.empty()) return 1000.0;
  Eigen::Matrix3d found;
  cv::cv2eigen(h, found);
  return test::cornerError(found, pair.truth, kSize);
}

/// Largest and median corner error over all pairs: of the chain, with alignment, and of OpenCV.
void expectAccurate(const std::vector<Pair>& pairs, double largest_allowed, double times_better) {
  std::vector<double> chain, aligned, opencv;
  for (const Pair& pair : pairs) {
    chain.push_back(errorOf(pair, chainOfThePaper()));
    aligned.push_back(errorOf(pair, MatcherOptions()));
    opencv.push_back(errorOfOpencv(pair));
    std::printf("%-32s corner error in px: %.3f, aligned %.3f, OpenCV's %.3f\n", pair.name.c_str(),
                chain.back(), aligned.back(), opencv.back());
    EXPECT_LT(aligned.back(), largest_allowed) << pair.name;
  }
  std::printf("median: %.3f, aligned %.3f, OpenCV's %.3f\n", metrics::median(chain),
              metrics::median(aligned), metrics::median(opencv));
  EXPECT_LT(metrics::median(chain), metrics::median(opencv));
  EXPECT_LT(metrics::median(aligned) * times_better, metrics::median(opencv));
}

/// Filters that let hundreds of wrong matches through must not lead to a homography.
void expectNothingBetween(const std::vector<cv::Mat>& pictures) {
  MatcherOptions options;
  options.ratio_threshold = 0.95;
  options.gms.threshold = 0.0;
  KtgpMatcher matcher(options);
  std::vector<Features> features;
  features.reserve(pictures.size());
  for (const cv::Mat& picture : pictures) {
    ASSERT_FALSE(picture.empty());
    features.push_back(test::featuresOf(picture));
  }
  for (std::size_t i = 0; i < features.size(); ++i) {
    for (std::size_t j = 0; j < features.size(); ++j) {
      if (i == j) continue;
      MatchResult result;
      matcher.match(features[i], features[j], result);
      EXPECT_NE(result.status, Status::ok) << i << " and " << j;
    }
  }
}

TEST(DrawnImages, HaveTheMatchesOfTheNaiveChain) {
  for (const Pair& pair : viewsOfAll(drawnPictures())) expectChainOfThePaper(pair);
}

TEST(DrawnImages, HaveTheHomographyTheyWereDrawnWith) {
  expectAccurate(viewsOfAll(drawnPictures()), 0.2, 10.0);
}

TEST(DrawnImages, HaveNothingInCommonWithOthers) {
  expectNothingBetween(drawnPictures());
}

TEST(OxfordImages, DifferentSetsDoNotMatch) {
  KTGP_ORB_REQUIRE_FOLDER(test::dataFolder(), "KTGP_ORB_DATA");
  for (int k = 1; k <= 6; k += 5) {
    expectNothingBetween({test::oxfordImage("leuven", k), test::oxfordImage("bikes", k),
                          test::oxfordImage("boat", k)});
  }
}

class Photographs : public testing::Test {
 protected:
  void SetUp() override {
    if (!test::photoFolder()) {
      GTEST_SKIP() << "needs the photographs of Debian's opencv-doc (scripts/setup test), or of a "
                      "folder named by KTGP_ORB_PHOTOS";
    }
  }
};

TEST_F(Photographs, HaveTheMatchesOfTheNaiveChain) {
  for (const Pair& pair : viewsOfAll(photographs())) expectChainOfThePaper(pair);
}

TEST_F(Photographs, HaveTheHomographyTheyWereMovedBy) {
  expectAccurate(viewsOfAll(photographs()), 0.2, 10.0);
}

TEST_F(Photographs, HaveNothingInCommonWithOthers) {
  expectNothingBetween(photographs());
}

/// Two photographs of a wall from 50 degrees apart, with the homography that is published for them.
TEST_F(Photographs, TiltedWallMatches) {
  Pair pair;
  pair.reference = cv::imread(*test::photoFolder() + "/graf1.png", cv::IMREAD_GRAYSCALE);
  pair.target = cv::imread(*test::photoFolder() + "/graf3.png", cv::IMREAD_GRAYSCALE);
  ASSERT_FALSE(pair.reference.empty() || pair.target.empty());
  cv::Mat truth;
  cv::FileStorage(*test::photoFolder() + "/H1to3p.xml", cv::FileStorage::READ)
          .getFirstTopLevelNode() >>
      truth;
  cv::cv2eigen(truth, pair.truth);
  const double error = errorOf(pair, MatcherOptions::robust());
  std::printf("corner error in px: %.3f\n", error);
  EXPECT_LT(error, 1.5);
}

}  // namespace
}  // namespace ktgp_orb
