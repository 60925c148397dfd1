// The pose of a flat target compared with the truth, and its covariance with the measured errors.
#include "ktgp_orb/planar_pose.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <random>
#include <stdexcept>

namespace ktgp_orb {
namespace {

const cv::Size kReference(800, 600);
constexpr double kWidth = 0.4;  // m

Eigen::Matrix3d camera() {
  Eigen::Matrix3d k;
  k << 525.0, 0.0, 319.5, 0.0, 530.0, 239.5, 0.0, 0.0, 1.0;
  return k;
}

Eigen::Isometry3d somePose() {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = (Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitX()) *
                   Eigen::AngleAxisd(-0.3, Eigen::Vector3d::UnitY()) *
                   Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()))
                      .toRotationMatrix();
  pose.translation() << 0.05, -0.1, 0.9;
  return pose;
}

/// Projects the target's points one by one: no formula of the code under test.
Eigen::Vector2d project(const Eigen::Isometry3d& pose, const Eigen::Vector2d& reference) {
  const double metre = kWidth / kReference.width;
  const Eigen::Vector3d on_target(metre * (reference.x() - 399.5), metre * (reference.y() - 299.5),
                                  0.0);
  return (camera() * (pose * on_target)).hnormalized();
}

/// The homography through the four corners with `noise` px on each, by plain linear equations.
Eigen::Matrix3d fit(const Eigen::Isometry3d& pose, double noise, std::mt19937& random) {
  std::normal_distribution<double> normal(0.0, 1.0);
  Eigen::Matrix<double, 8, 8> a;
  Eigen::Matrix<double, 8, 1> b;
  int row = 0;
  for (const Eigen::Vector2d& p : {Eigen::Vector2d(0, 0), Eigen::Vector2d(799, 0),
                                   Eigen::Vector2d(799, 599), Eigen::Vector2d(0, 599)}) {
    const Eigen::Vector2d q =
        project(pose, p) + noise * Eigen::Vector2d(normal(random), normal(random));
    a.row(row) << p.x(), p.y(), 1, 0, 0, 0, -q.x() * p.x(), -q.x() * p.y();
    b(row++) = q.x();
    a.row(row) << 0, 0, 0, p.x(), p.y(), 1, -q.y() * p.x(), -q.y() * p.y();
    b(row++) = q.y();
  }
  const Eigen::Matrix<double, 8, 1> h = a.fullPivLu().solve(b);
  Eigen::Matrix3d out;
  out << h(0), h(1), h(2), h(3), h(4), h(5), h(6), h(7), 1.0;
  return out;
}

/// Measured covariance of fit()'s results.
Covariance8 covarianceOf(const Eigen::Isometry3d& pose, double noise, std::mt19937& random) {
  constexpr int kTrials = 4000;
  const Eigen::Matrix3d truth = fit(pose, 0.0, random);
  Covariance8 sum = Covariance8::Zero();
  for (int i = 0; i < kTrials; ++i) {
    const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> off = fit(pose, noise, random) - truth;
    const Eigen::Map<const Eigen::Matrix<double, 8, 1>> d(off.data());
    sum += d * d.transpose();
  }
  return sum / kTrials;
}

Eigen::Matrix<double, 6, 1> difference(const Eigen::Isometry3d& found,
                                       const Eigen::Isometry3d& truth) {
  const Eigen::AngleAxisd turn(Eigen::Matrix3d(found.linear() * truth.linear().transpose()));
  Eigen::Matrix<double, 6, 1> d;
  d << found.translation() - truth.translation(), turn.angle() * turn.axis();
  return d;
}

TEST(PlanarPose, IsTheTruthForATrueHomography) {
  std::mt19937 random(1);
  const Eigen::Isometry3d truth = somePose();
  const Covariance8 covariance = covarianceOf(truth, 0.5, random);
  const Eigen::Matrix3d h = fit(truth, 0.0, random);
  for (const double scale : {1.0, -3.0}) {  // a homography has no scale
    const auto found = planarPose(scale * h, covariance, camera(), kReference, kWidth);
    ASSERT_TRUE(found);
    EXPECT_LT(difference(found->target_to_camera, truth).norm(), 1e-6);
  }
}

TEST(PlanarPose, CovarianceIsWhatHappens) {
  std::mt19937 random(2);
  const Eigen::Isometry3d truth = somePose();
  const Covariance8 covariance = covarianceOf(truth, 0.5, random);
  double sum = 0.0;
  double translation = 0.0;
  constexpr int kTrials = 2000;
  for (int i = 0; i < kTrials; ++i) {
    const auto found =
        planarPose(fit(truth, 0.5, random), covariance, camera(), kReference, kWidth);
    ASSERT_TRUE(found);
    const auto d = difference(found->target_to_camera, truth);
    sum += d.dot(found->covariance.ldlt().solve(d));
    translation += d.head<3>().squaredNorm();
  }
  EXPECT_NEAR(sum / kTrials, 6.0, 0.6) << "normalised squared error of six numbers";
  EXPECT_LT(std::sqrt(translation / kTrials), 0.01) << "m, at 0.9 m";
}

TEST(PlanarPose, IsThereWithoutACovariance) {
  std::mt19937 random(3);
  Covariance8 unknown;
  unknown.setConstant(std::nan(""));
  const auto found =
      planarPose(fit(somePose(), 0.0, random), unknown, camera(), kReference, kWidth);
  ASSERT_TRUE(found);
  EXPECT_LT(difference(found->target_to_camera, somePose()).norm(), 1e-6);
  EXPECT_TRUE(found->covariance.array().isNaN().all());
}

TEST(PlanarPose, IsNotThereForAMirrorImageOrNothing) {
  std::mt19937 random(4);
  Eigen::Matrix3d mirrored = fit(somePose(), 0.0, random);
  mirrored.col(0) *= -1.0;
  const Covariance8 one = Covariance8::Identity();
  EXPECT_FALSE(planarPose(Eigen::Matrix3d::Zero(), one, camera(), kReference, kWidth));
  EXPECT_FALSE(planarPose(mirrored, one, camera(), kReference, kWidth));
}

TEST(PlanarPose, RefusesACameraOrATargetOfNoSize) {
  const Covariance8 one = Covariance8::Identity();
  const Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  EXPECT_THROW(planarPose(h, one, camera(), kReference, 0.0), std::invalid_argument);
  EXPECT_THROW(planarPose(h, one, Eigen::Matrix3d::Zero(), kReference, 1.0), std::invalid_argument);
  EXPECT_THROW(planarPose(h, one, camera(), {}, 1.0), std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb
