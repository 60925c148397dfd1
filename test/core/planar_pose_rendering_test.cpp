// Poses from exact renderings of a picture at known positions, tilted by up to 60 degrees.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "evaluation/rendering.h"
#include "frame_pair.h"
#include "ktgp_orb/planar_pose.h"
#include "orb_test_images.h"

namespace ktgp_orb {
namespace {

const cv::Size kSize(640, 480);
constexpr double kWidth = 0.4;  // m
constexpr double kPi = 3.14159265358979;

Eigen::Matrix3d camera() {
  return test::cameraMatrix(500.0, 500.0);
}

/// Tilted by `tilt` about a random axis in the picture, and rotated by up to 20 degrees. More
/// tilted pictures are farther away, so that they stay in view.
Eigen::Isometry3d drawPose(double tilt, test::Numbers& numbers) {
  const double direction = numbers.uniform(0.0, 2.0 * kPi);
  const Eigen::Vector3d axis(std::cos(direction), std::sin(direction), 0.0);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = (Eigen::AngleAxisd(tilt, axis) *
                   Eigen::AngleAxisd(numbers.uniform(-0.35, 0.35), Eigen::Vector3d::UnitZ()))
                      .toRotationMatrix();
  pose.translation() << numbers.uniform(-0.04, 0.04), numbers.uniform(-0.03, 0.03),
      numbers.uniform(0.4, 0.55);
  return pose;
}

Eigen::Matrix3d homographyOf(const Eigen::Isometry3d& pose) {
  const double metre = kWidth / kSize.width;
  const Eigen::Matrix3d target = test::cameraMatrix(metre, metre, -0.5 * metre * (kSize.width - 1),
                                                    -0.5 * metre * (kSize.height - 1));
  Eigen::Matrix3d plane;
  plane << pose.linear().col(0), pose.linear().col(1), pose.translation();
  const Eigen::Matrix3d h = camera() * plane * target;
  return h / h(2, 2);
}

/// The picture has twice the resolution of the reference image, so that both images are views of
/// it.
constexpr double kFiner = 2.0;

/// The camera's view of the picture through a homography from the reference image, with some sensor
/// noise.
cv::Mat view(const cv::Mat& picture, const Eigen::Matrix3d& homography, int seed) {
  cv::Mat source;
  picture.convertTo(source, CV_32F);
  const double middle = 0.5 * (kFiner - 1.0);
  const Eigen::Matrix3d finer = test::cameraMatrix(kFiner, kFiner, middle, middle);
  return test::withNoise(tools::renderView(source, finer * homography.inverse(), kSize), 2.0,
                         static_cast<std::uint64_t>(seed));
}

TEST(PlanarPose, CovarianceIsWhatHappensInRenderings) {
  constexpr int kPoses = 60;
  constexpr double kChi6 = 22.46;  // 99.9 %
  cv::Mat picture;
  cv::GaussianBlur(test::textureImage(kSize * static_cast<int>(kFiner), 3), picture, cv::Size(),
                   2.0);
  const Features reference = test::featuresOf(view(picture, Eigen::Matrix3d::Identity(), 1000));
  KtgpMatcher matcher(MatcherOptions::robust());
  MatchResult result;
  test::Numbers numbers(11);
  std::vector<double> normalised;
  for (int i = 0; i < kPoses; ++i) {
    const double tilt = i * (kPi / 3.0) / (kPoses - 1);
    const Eigen::Isometry3d truth = drawPose(tilt, numbers);
    matcher.match(reference, test::featuresOf(view(picture, homographyOf(truth), i)), result);
    if (result.status != Status::ok) continue;
    const auto found =
        planarPoses(result.answer.homography, result.answer.covariance, camera(), kSize, kWidth)
            .poses;
    ASSERT_FALSE(found.empty());
    const Eigen::Isometry3d pose = found[0].target_to_camera;
    const Eigen::AngleAxisd turn(Eigen::Matrix3d(pose.linear() * truth.linear().transpose()));
    Eigen::Matrix<double, 6, 1> error;
    error << pose.translation() - truth.translation(), turn.angle() * turn.axis();
    const Eigen::Matrix<double, 6, 6> covariance = found[0].covariance;
    normalised.push_back(error.dot(covariance.ldlt().solve(error)));
  }
  ASSERT_GE(normalised.size(), 50u) << "found";
  const auto within = std::count_if(normalised.begin(), normalised.end(),
                                    [](double value) { return value < kChi6; });
  const double median = evaluation::median(normalised);
  RecordProperty("within", std::to_string(within));
  RecordProperty("median", std::to_string(median));
  EXPECT_GE(static_cast<double>(within), 0.98 * static_cast<double>(normalised.size()));
  EXPECT_GT(median, 1.5);  // 5.35 if the covariance is exactly right
  EXPECT_LT(median, 8.5);
}

}  // namespace
}  // namespace ktgp_orb
