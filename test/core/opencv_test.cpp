#include "ktgp_orb/opencv.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "orb_test_images.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using test::Numbers;

const cv::Size kSize(640, 480);

/// The message of the std::exception that `call` throws; empty if it throws none.
std::string errorOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

// Features

bool sameKeypoint(const cv::KeyPoint& a, const cv::KeyPoint& b) {
  return a.pt == b.pt && a.octave == b.octave && a.angle == b.angle && a.size == b.size &&
         a.response == b.response;
}

TEST(Feature2D, GivesTheBytesOfTheExtractor) {
  const cv::Mat image = test::textureImage(kSize, 1);
  for (const DescriptorKind kind : {DescriptorKind::orb, DescriptorKind::teblid}) {
    OrbOptions options;
    options.max_features = 500;
    options.descriptor = kind;
    Features expected;
    OrbExtractor(options).extract(image, expected);
    const cv::Ptr<cv::Feature2D> features = createFeature2D(options);
    std::vector<cv::KeyPoint> keypoints, detected;
    cv::Mat descriptors;
    features->detectAndCompute(image, cv::noArray(), keypoints, descriptors);
    features->detect(image, detected);
    ASSERT_GT(expected.size(), 400u);
    ASSERT_EQ(keypoints.size(), expected.size());
    ASSERT_EQ(detected.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) {
      EXPECT_TRUE(sameKeypoint(keypoints[i], expected.keypoints[i])) << i;
      EXPECT_TRUE(sameKeypoint(detected[i], expected.keypoints[i])) << i;
    }
    EXPECT_EQ(cv::norm(descriptors, expected.descriptors, cv::NORM_INF), 0.0);
    EXPECT_EQ(descriptors.cols, features->descriptorSize());
    EXPECT_EQ(descriptors.type(), features->descriptorType());
    EXPECT_EQ(features->defaultNorm(), static_cast<int>(cv::NORM_HAMMING));
    EXPECT_FALSE(features->empty());
  }
}

TEST(Feature2D, FindsTheKeypointsOfOpencv) {
  const cv::Mat image = test::textureImage(kSize, 2);
  std::vector<cv::KeyPoint> ours, theirs;
  createFeature2D()->detect(image, ours);
  cv::ORB::create(2000)->detect(image, theirs);
  ASSERT_EQ(ours.size(), theirs.size());
  for (std::size_t i = 0; i < ours.size(); ++i) EXPECT_EQ(ours[i].pt, theirs[i].pt) << i;
}

TEST(Feature2D, TakesMasksAndColour) {
  const cv::Mat image = test::textureImage(kSize, 3);
  const cv::Ptr<cv::Feature2D> features = createFeature2D();
  cv::Mat mask = cv::Mat::zeros(kSize, CV_8U);
  mask(cv::Rect(320, 0, 320, 480)) = 255;
  std::vector<cv::KeyPoint> grey, colour, transparent;
  features->detect(image, grey, mask);
  ASSERT_GT(grey.size(), 100u);
  for (const cv::KeyPoint& keypoint : grey) EXPECT_GE(keypoint.pt.x, 319.0F);

  cv::Mat bgr, bgra;
  cv::cvtColor(image, bgr, cv::COLOR_GRAY2BGR);
  cv::cvtColor(image, bgra, cv::COLOR_GRAY2BGRA);
  features->detect(bgr, colour, mask);
  features->detect(bgra, transparent, mask);
  EXPECT_TRUE(std::equal(grey.begin(), grey.end(), colour.begin(), colour.end(), sameKeypoint));
  EXPECT_TRUE(
      std::equal(grey.begin(), grey.end(), transparent.begin(), transparent.end(), sameKeypoint));
}

TEST(Feature2D, RefusesWhatItCannotDo) {
  const cv::Ptr<cv::Feature2D> features = createFeature2D();
  std::vector<cv::KeyPoint> keypoints{cv::KeyPoint(100.0F, 100.0F, 31.0F)};
  cv::Mat descriptors;
  const cv::Mat image = test::textureImage(kSize, 4);
  EXPECT_NE(errorOf([&] {
              features->compute(image, keypoints, descriptors);
            }).find("expected detectAndCompute"),
            std::string::npos);
  EXPECT_THROW(features->detect(cv::Mat(kSize, CV_16U), keypoints), std::invalid_argument);
  EXPECT_THROW(features->detect(image, keypoints, cv::Mat::ones(10, 10, CV_8U)), std::exception);
  OrbOptions wrong;
  wrong.levels = 0;
  EXPECT_THROW(createFeature2D(wrong), std::invalid_argument);

  descriptors = cv::Mat::ones(3, 32, CV_8U);
  features->detectAndCompute(cv::Mat(kSize, CV_8U, cv::Scalar(7)), cv::noArray(), keypoints,
                             descriptors);
  EXPECT_TRUE(keypoints.empty());
  EXPECT_TRUE(descriptors.empty());
}

/// What a user of OpenCV does: features, brute force, one homography.
TEST(Feature2D, MatchesByBruteForce) {
  const cv::Mat image = test::textureImage(kSize, 5);
  const cv::Mat truth = (cv::Mat_<double>(3, 3) << 0.95, -0.08, 30, 0.08, 0.95, -9, 0, 0, 1);
  cv::Mat moved;
  cv::warpPerspective(image, moved, truth, kSize);
  const cv::Ptr<cv::Feature2D> features = createFeature2D();
  std::vector<cv::KeyPoint> reference, target;
  cv::Mat of_reference, of_target;
  features->detectAndCompute(image, cv::noArray(), reference, of_reference);
  features->detectAndCompute(moved, cv::noArray(), target, of_target);
  std::vector<cv::DMatch> matches;
  cv::BFMatcher(features->defaultNorm(), true).match(of_reference, of_target, matches);
  std::vector<cv::Point2f> from, to;
  for (const cv::DMatch& match : matches) {
    from.push_back(reference[static_cast<std::size_t>(match.queryIdx)].pt);
    to.push_back(target[static_cast<std::size_t>(match.trainIdx)].pt);
  }
  const ProsacResult found = estimateHomography(from, to);
  ASSERT_EQ(found.status, Status::ok);
  Eigen::Matrix3d expected;
  cv::cv2eigen(truth, expected);
  EXPECT_LT(test::cornerError(found.answer.homography, expected, kSize), 1.0);
}

// Matches

TEST(DMatches, HaveTheReferenceFirst) {
  const std::vector<Correspondence> correspondences{{7, 0, 20, 40, Level::ktgp},
                                                    {3, 1, 10, 30, Level::kt},
                                                    {-1, 2, 256, 256, Level::knn},
                                                    {5, 3, 12, 33, Level::guided}};
  const std::vector<cv::DMatch> inliers = toDMatches(correspondences);
  ASSERT_EQ(inliers.size(), 2u);
  EXPECT_EQ(inliers[0].queryIdx, 7);
  EXPECT_EQ(inliers[0].trainIdx, 0);
  EXPECT_EQ(inliers[0].distance, 20.0F);
  EXPECT_EQ(inliers[1].queryIdx, 5);
  EXPECT_EQ(toDMatches(correspondences, Level::kt).size(), 3u);
  EXPECT_EQ(toDMatches(correspondences, Level::knn).size(), 3u);
  EXPECT_TRUE(toDMatches({}).empty());

  cv::Mat drawn;
  const cv::Mat image = cv::Mat::zeros(50, 50, CV_8U);
  const std::vector<cv::KeyPoint> reference(8, cv::KeyPoint(9.0F, 9.0F, 1.0F));
  const std::vector<cv::KeyPoint> target(4, cv::KeyPoint(20.0F, 20.0F, 1.0F));
  EXPECT_NO_THROW(cv::drawMatches(image, reference, image, target, inliers, drawn));
}

// Homographies

std::vector<cv::Point2d> toPoints(const std::vector<Eigen::Vector2d>& points) {
  std::vector<cv::Point2d> result;
  for (const Eigen::Vector2d& p : points) result.emplace_back(p.x(), p.y());
  return result;
}

/// Points in OpenCV's types and the truth.
struct Problem {
  std::vector<cv::Point2d> reference, target;
  std::vector<double> noise;
  Eigen::Matrix3d truth;
};

/// 120 pairs, of which every fourth is wrong, and every second right one has ten times the noise.
Problem noisyProblem(std::uint64_t seed, double noise = 0.5) {
  Numbers numbers(seed);
  test::Scene scene;
  scene.homography = test::randomHomography(kSize, 0.15, numbers);
  scene.sigma = 0.0;
  scene.pairs = 120;
  scene.inliers = 90;
  const PointPairs pairs = test::makePairs(scene, numbers);
  Problem problem{toPoints(pairs.reference), toPoints(pairs.target), {}, scene.homography};
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double sigma = i % 2 == 0 ? noise : 10.0 * noise;
    problem.noise.push_back(sigma);
    problem.target[i] += cv::Point2d(sigma * numbers.normal(), sigma * numbers.normal());
  }
  return problem;
}

TEST(EstimateHomography, GivesTheBytesOfTheCoreForEveryType) {
  Numbers numbers(1);
  test::Scene scene;
  scene.homography = test::randomHomography(kSize, 0.1, numbers);
  PointPairs pairs = test::makePairs(scene, numbers);
  for (auto* points : {&pairs.reference, &pairs.target}) {  // the same in single precision
    for (Eigen::Vector2d& p : *points) p = p.cast<float>().cast<double>();
  }
  pairs.quality.assign(pairs.size(), 0.0);
  ProsacResult expected;
  ProsacHomography().estimate(pairs, {}, expected);
  ASSERT_EQ(expected.status, Status::ok);

  const std::vector<cv::Point2d> reference = toPoints(pairs.reference);
  const std::vector<cv::Point2d> target = toPoints(pairs.target);
  const std::vector<cv::Point2f> single(reference.begin(), reference.end());
  const cv::Mat rows = cv::Mat(target).reshape(1);
  cv::Mat wide(rows.rows, 5, CV_64F);
  rows.copyTo(wide.colRange(1, 3));
  for (const ProsacResult& found :
       {estimateHomography(reference, target), estimateHomography(single, target),
        estimateHomography(single, rows), estimateHomography(reference, wide.colRange(1, 3)),
        estimateHomography(single, cv::Mat(target).t())}) {
    EXPECT_EQ(found.status, Status::ok);
    EXPECT_EQ(found.answer.homography, expected.answer.homography);
    EXPECT_EQ(found.answer.covariance, expected.answer.covariance);
    EXPECT_EQ(found.mask, expected.mask);
  }
}

TEST(EstimateHomography, AgreesWithOpencv) {
  const Problem exact = noisyProblem(2, 1e-6);
  cv::Mat mask;
  const cv::Mat theirs = cv::findHomography(exact.reference, exact.target, mask, cv::RANSAC, 3.0);
  const ProsacResult ours = estimateHomography(exact.reference, exact.target);
  Eigen::Matrix3d h;
  cv::cv2eigen(theirs, h);
  EXPECT_LT(test::cornerError(ours.answer.homography, h, kSize), 1e-3);
  EXPECT_EQ(cv::norm(cv::Mat(ours.mask), mask, cv::NORM_INF), 0.0);
}

TEST(EstimateHomography, RefusesBadInput) {
  std::vector<cv::Point2f> four{{0, 0}, {100, 0}, {100, 100}, {0, 100}};
  std::vector<cv::Point2f> five = four;
  five.emplace_back(50.0F, 50.0F);
  EXPECT_EQ(errorOf([&] { estimateHomography(four, five); }),
            "there are 4 reference points and 5 target points; expected equal numbers");
  EXPECT_EQ(errorOf([&] { estimateHomography(std::vector<cv::Point3f>(5), five); }),
            "reference points are CV_32FC3, 5x1; expected two coordinates per point");
  std::vector<cv::Point2f> bad = five;
  bad[3].y = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(errorOf([&] { estimateHomography(five, bad); }),
            "point pair 3 is not finite; expected finite coordinates and quality");
  const std::vector<cv::Point2f> none;
  EXPECT_EQ(estimateHomography(none, none).status, Status::too_few_matches);
  four.pop_back();
  EXPECT_EQ(estimateHomography(four, four).status, Status::too_few_matches);
  ProsacOptions wrong;
  wrong.max_error = -1.0;
  EXPECT_NE(errorOf([&] { estimateHomography(five, five, wrong); }).find("max_error is -1"),
            std::string::npos);
}

TEST(EstimateHomography, RefusesBadNoise) {
  const Problem problem = noisyProblem(3);
  for (const double bad : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN(),
                           std::numeric_limits<double>::infinity()}) {
    std::vector<double> noise = problem.noise;
    noise[7] = bad;
    const std::string error =
        errorOf([&] { estimateHomography(problem.reference, problem.target, noise); });
    EXPECT_EQ(error.find("noise of point pair 7 in px is "), 0u) << error;
  }
  EXPECT_EQ(errorOf([&] {
              estimateHomography(problem.reference, problem.target, std::vector<double>{1.0, 2.0});
            }),
            "there are 2 noises and 120 point pairs; expected one per pair");
  EXPECT_NE(errorOf([&] {
              estimateHomography(problem.reference, problem.target, cv::Mat::ones(120, 2, CV_64F));
            }).find("expected one value per point"),
            std::string::npos);
}

TEST(WeightedHomography, EqualNoiseChangesNothing) {
  const Problem problem = noisyProblem(4, 0.1);
  const std::vector<float> equal(problem.reference.size(), 1.0F);
  const ProsacResult plain = estimateHomography(problem.reference, problem.target);
  const ProsacResult found = estimateHomography(problem.reference, problem.target, equal);
  ASSERT_EQ(plain.status, Status::ok);
  EXPECT_EQ(found.answer.homography, plain.answer.homography);
  EXPECT_EQ(found.mask, plain.mask);
}

/// Root mean square corner error over many scenes.
template <typename Estimate>
double errorOver(int scenes, Estimate estimate) {
  double sum = 0.0;
  for (int seed = 0; seed < scenes; ++seed) {
    const Problem problem = noisyProblem(static_cast<std::uint64_t>(seed));
    const ProsacResult found = estimate(problem);
    EXPECT_EQ(found.status, Status::ok) << seed;
    const double error = test::cornerError(found.answer.homography, problem.truth, kSize);
    sum += error * error;
  }
  return std::sqrt(sum / scenes);
}

TEST(WeightedHomography, IsNotSpoiltByTenTimesTheNoise) {
  constexpr int kScenes = 100;
  const double weighted = errorOver(
      kScenes, [](const Problem& p) { return estimateHomography(p.reference, p.target, p.noise); });
  const double alike = errorOver(
      kScenes, [](const Problem& p) { return estimateHomography(p.reference, p.target); });
  const double good_only = errorOver(kScenes, [](const Problem& p) {
    Problem good;
    for (std::size_t i = 0; i < p.reference.size(); i += 2) {
      good.reference.push_back(p.reference[i]);
      good.target.push_back(p.target[i]);
    }
    return estimateHomography(good.reference, good.target);
  });
  RecordProperty("weighted", std::to_string(weighted));
  RecordProperty("alike", std::to_string(alike));
  RecordProperty("good_only", std::to_string(good_only));
  EXPECT_LT(weighted, 1.02 * good_only);
  EXPECT_LT(weighted, 0.8 * alike);
}

/// The median of e' C^-1 e over many scenes. `factor`: the noise that is given over the true one.
double normalisedError(double factor) {
  constexpr int kScenes = 300;
  std::vector<double> normalised;
  for (int seed = 0; seed < kScenes; ++seed) {
    Problem problem = noisyProblem(static_cast<std::uint64_t>(1000 + seed));
    for (double& noise : problem.noise) noise *= factor;
    const ProsacResult found = estimateHomography(problem.reference, problem.target, problem.noise);
    EXPECT_EQ(found.status, Status::ok) << seed;
    if (found.status != Status::ok) continue;
    Eigen::Matrix<double, 8, 1> error;
    for (int i = 0; i < 8; ++i) {
      error[i] = found.answer.homography(i / 3, i % 3) - problem.truth(i / 3, i % 3);
    }
    const Eigen::Matrix<double, 8, 8> covariance = found.answer.covariance;
    normalised.push_back(error.dot(covariance.ldlt().solve(error)));
  }
  std::sort(normalised.begin(), normalised.end());
  return normalised[normalised.size() / 2];
}

TEST(WeightedHomography, HasAnHonestCovariance) {
  constexpr double kMedian = 7.34;  // of chi-square with eight degrees of freedom
  for (const double factor : {1.0, 0.7, 2.0}) {
    const double median = normalisedError(factor);
    RecordProperty("median_" + std::to_string(factor), std::to_string(median));
    EXPECT_GT(median, 0.75 * kMedian) << factor;
    EXPECT_LT(median, 1.25 * kMedian) << factor;
  }
}

}  // namespace
}  // namespace ktgp_orb
