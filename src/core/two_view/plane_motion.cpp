#include "core/two_view/plane_motion.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <vector>

#include "core/two_view/epipolar.h"

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

}  // namespace

void setPlaneMotion(const PointPairs& pairs, const Cameras& cameras, const Covariance8& covariance,
                    double max_error, TwoView& view) {
  cv::Matx33d calibrated;
  const Eigen::Matrix3d g = cameras.target_inverse * view.homography * cameras.reference;
  for (int i = 0; i < 9; ++i) calibrated(i / 3, i % 3) = g(i / 3, i % 3);
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
    for (int i = 0; i < 9; ++i) {
      motion.rotation(i / 3, i % 3) = rotations[k].at<double>(i / 3, i % 3);
    }
    for (int i = 0; i < 3; ++i) {
      motion.translation[i] = translations[k].at<double>(i);
      motion.normal[i] = normals[k].at<double>(i);
    }
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
  if (second) view.other_pose = RelativePose{second->rotation, second->translation.normalized()};
  view.pose_covariance = covarianceOf(*best, cameras, covariance);
}

}  // namespace ktgp_orb::two_view
