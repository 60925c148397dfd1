#include "two_view/motions.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <optional>
#include <vector>

namespace ktgp_orb::two_view {
namespace {

/// A motion over a plane: K'^-1 H K = R + t n^T.
struct PlanarMotion {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;  // over the distance of the plane
  Eigen::Vector3d normal;
};

/// `of_homography` propagated to the motion.
Covariance6 covarianceOf(const PlanarMotion& motion, const Cameras& cameras,
                         const Covariance8& of_homography) {
  // H's first eight entries by rotation, translation and the plane's normal.
  const double length = motion.translation.norm();
  const Eigen::Vector3d direction = motion.translation / length;
  const Eigen::Matrix<double, 3, 2> around = across(direction);
  const Eigen::Matrix<double, 3, 2> tilts = across(motion.normal);
  const Eigen::Matrix3d product = motion.rotation + motion.translation * motion.normal.transpose();
  const Eigen::Matrix3d h = cameras.target * product * cameras.reference_inverse;
  Eigen::Matrix<double, 8, 8> by_motion;
  const auto set = [&](int column, const Eigen::Matrix3d& change) {
    const Eigen::Matrix3d d = cameras.target * change * cameras.reference_inverse;
    for (int i = 0; i < 8; ++i) {
      by_motion(i, column) = (d(i / 3, i % 3) - h(i / 3, i % 3) / h(2, 2) * d(2, 2)) / h(2, 2);
    }
  };
  for (int i = 0; i < 3; ++i) set(i, crossed(Eigen::Vector3d::Unit(i)) * motion.rotation);
  for (int i = 0; i < 2; ++i) set(3 + i, length * around.col(i) * motion.normal.transpose());
  set(5, motion.translation * motion.normal.transpose());
  for (int i = 0; i < 2; ++i) set(6 + i, motion.translation * tilts.col(i).transpose());
  const Eigen::Matrix<double, 8, 8> back = by_motion.inverse();
  const Eigen::Matrix<double, 8, 8> covariance = back * of_homography * back.transpose();
  return poseCovariance(covariance.topLeftCorner<5, 5>(), direction);
}

Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d r = svd.matrixU() * svd.matrixV().transpose();
  if (r.determinant() < 0.0) r = -r;
  return r;
}

}  // namespace

void setPlaneMotion(const PointPairs& pairs, const Cameras& cameras, const Covariance8& covariance,
                    double max_error, TwoView& view) {
  cv::Matx33d calibrated;
  cv::eigen2cv(Eigen::Matrix3d(cameras.target_inverse * view.homography * cameras.reference),
               calibrated);
  std::vector<cv::Mat> rotations;
  std::vector<cv::Mat> translations;
  std::vector<cv::Mat> normals;
  cv::decomposeHomographyMat(calibrated, cv::Matx33d::eye(), rotations, translations, normals);
  std::optional<PlanarMotion> best;
  std::optional<PlanarMotion> second;
  double best_cost = 0.0;
  double second_cost = 0.0;
  for (std::size_t k = 0; k < rotations.size(); ++k) {
    PlanarMotion motion;
    cv::cv2eigen(rotations[k], motion.rotation);
    cv::cv2eigen(translations[k], motion.translation);
    cv::cv2eigen(normals[k], motion.normal);
    const double length = motion.translation.norm();
    if (!(length > 1e-9) || !(motion.rotation.determinant() > 0.0)) continue;
    std::size_t front = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      front +=
          view.mask[i] != 0 && motion.normal.dot(cameras.referenceRay(pairs.reference[i])) > 0.0;
    }
    if (2 * front < view.inliers) continue;
    const Eigen::Matrix3d f = cameras.fundamentalOf({motion.rotation, motion.translation / length});
    const double limit = kSampsonShare * max_error;
    double cost = 1e-3 * static_cast<double>(pairs.size()) * (1.0 - motion.normal.z());
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const double error = sampson(f, pairs.reference[i], pairs.target[i]);
      cost += view.mask[i] != 0 ? 0.0 : std::min(error / limit, 1.0);
    }
    if (!best || cost < best_cost) {
      second = best;
      second_cost = best_cost;
      best = motion;
      best_cost = cost;
    } else if (!second || cost < second_cost) {
      second = motion;
      second_cost = cost;
    }
  }
  if (!best) return;
  const Eigen::Vector3d direction = best->translation.normalized();
  view.pose = {best->rotation, direction};
  view.fundamental = cameras.fundamentalOf({best->rotation, direction}).normalized();
  if (second) {
    view.probability = 0.5;
    view.other = OtherMotion{Geometry::plane,
                             {second->rotation, second->translation.normalized()},
                             covarianceOf(*second, cameras, covariance),
                             0.5};
  }
  view.pose_covariance = covarianceOf(*best, cameras, covariance);
}

Eigen::Matrix3d turnOf(const EpipolarPairs& pairs) {
  constexpr int kRounds = 5;  // the first two weigh all pairs alike
  constexpr std::size_t kMost = 200;
  constexpr double kLeastScale2 = 1e-18;  // rad²; pairs that do not move have none
  const std::size_t n = std::min(pairs.size(), kMost);
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  double scale2 = std::numeric_limits<double>::infinity();
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    double weights = 0.0;
    double squares = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const Eigen::Vector3d from = pairs.referenceRay(i).normalized();
      const Eigen::Vector3d to = pairs.targetRay(i).normalized();
      const double e2 = (turn * from - to).squaredNorm();
      const double w = 1.0 / (1.0 + e2 / scale2);
      sum.noalias() += w * to * from.transpose();
      weights += w;
      squares += w * e2;
    }
    turn = nearestRotation(sum);
    scale2 = std::max(squares / weights, kLeastScale2);
  }
  return turn;
}

bool isForward(const EpipolarPairs& pairs, const RelativePose& motion) {
  const std::size_t n = std::min<std::size_t>(pairs.size(), 64);
  std::size_t front = 0;
  for (std::size_t i = 0; i < n; ++i) {
    front += inFront(motion, pairs.referenceRay(i), pairs.targetRay(i)) ? 1 : 0;
  }
  return 2 * front > n;
}

bool fitRotation(const PointPairs& pairs, const Cameras& cameras, const Eigen::Matrix3d& homography,
                 std::size_t inliers, double max_error, Eigen::Matrix3d& rotation,
                 Eigen::Matrix3d& covariance) {
  constexpr int kSteps = 8;
  constexpr double kFreedom = 4.0;  // of Student's t
  constexpr double kEntries = 3.0;
  rotation = nearestRotation(cameras.target_inverse * homography * cameras.reference);
  double scale2 = max_error * max_error / 4.0;
  std::size_t near = 0;
  for (int step = 0; step < kSteps; ++step) {
    Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d pulls = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    double weights = 0.0;
    double derivative = 0.0;
    double cost = 0.0;
    near = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const Eigen::Vector3d p = rotation * cameras.referenceRay(pairs.reference[i]);
      if (!(p.z() > 1e-6)) continue;
      const Eigen::Vector2d e = (cameras.target * p).hnormalized() - pairs.target[i];
      const double e2 = e.squaredNorm();
      const double reach = 2.0 * max_error;
      if (!(e2 < reach * reach)) continue;
      ++near;
      Eigen::Matrix<double, 2, 3> by_point;
      by_point << cameras.target(0, 0) / p.z(), cameras.target(0, 1) / p.z(),
          -(cameras.target(0, 0) * p.x() + cameras.target(0, 1) * p.y()) / (p.z() * p.z()), 0.0,
          cameras.target(1, 1) / p.z(), -cameras.target(1, 1) * p.y() / (p.z() * p.z());
      const Eigen::Matrix<double, 2, 3> jacobian = -by_point * crossed(p);
      const double w = (kFreedom + 2.0) * scale2 / (kFreedom * scale2 + e2);
      const Eigen::Vector3d pull = w * jacobian.transpose() * e;
      squares.noalias() += w * jacobian.transpose() * jacobian;
      pulls.noalias() += pull * pull.transpose();
      gradient += pull;
      weights += w;
      derivative += w * (1.0 - e2 / (kFreedom * scale2 + e2));
      cost += w * e2;
    }
    if (near <= 4 || 2 * near < inliers) return false;
    const Eigen::LDLT<Eigen::Matrix3d> ldlt(squares);
    if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return false;
    rotation = turned(-weights / derivative * ldlt.solve(gradient), rotation);
    const Eigen::Matrix3d bread =
        weights / derivative * ldlt.solve(Eigen::Matrix3d::Identity()).eval();
    const double n = 2.0 * static_cast<double>(near);
    covariance = n / (n - kEntries) * bread * pulls * bread.transpose();
    scale2 = std::max(n / (n - kEntries) * cost / (2.0 * weights), 1e-8);
  }
  rotation = nearestRotation(rotation);
  return true;
}

}  // namespace ktgp_orb::two_view
