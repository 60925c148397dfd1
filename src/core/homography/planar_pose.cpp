#include "ktgp_orb/planar_pose.h"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "core/util/small_matrix.h"

namespace ktgp_orb {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Vector8 = Eigen::Matrix<double, 8, 1>;
using Matrix86 = Eigen::Matrix<double, 8, 6>;

/// Reference image, px -> target, m.
Eigen::Matrix3d targetFromReference(const cv::Size& size, double width) {
  const double metre = width / size.width;  // a pixel is a square of that side
  Eigen::Matrix3d m;
  m << metre, 0.0, -0.5 * metre * (size.width - 1), 0.0, metre, -0.5 * metre * (size.height - 1),
      0.0, 0.0, 1.0;
  return m;
}

/// The first eight entries, row by row, with the last one 1.
Vector8 entries(const Eigen::Matrix3d& h) {
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rows = h / h(2, 2);
  return Eigen::Map<const Vector8>(rows.data());
}

/// The pose's homography: reference -> image.
Eigen::Matrix3d homographyOf(const Eigen::Isometry3d& pose, const Eigen::Matrix3d& camera,
                             const Eigen::Matrix3d& target_from_reference) {
  Eigen::Matrix3d plane;
  plane << pose.linear().col(0), pose.linear().col(1), pose.translation();
  return camera * plane * target_from_reference;
}

/// Moves by x, y, z and rotates about the camera's axes, in place.
Eigen::Isometry3d moved(const Eigen::Isometry3d& pose, const Vector6& step) {
  const Eigen::Vector3d turn = step.tail<3>();
  const double angle = turn.norm();
  Eigen::Isometry3d out = pose;
  if (angle > 0.0) {
    out.linear() =
        Eigen::AngleAxisd(angle, Eigen::Vector3d(turn / angle)).toRotationMatrix() * pose.linear();
  }
  out.translation() += step.head<3>();
  return out;
}

std::optional<Eigen::Isometry3d> decomposed(const Eigen::Matrix3d& homography,
                                            const Eigen::Matrix3d& camera,
                                            const Eigen::Matrix3d& target_from_reference) {
  Eigen::Matrix3d plane = camera.inverse() * homography * target_from_reference.inverse();
  const double scale = std::sqrt(plane.col(0).norm() * plane.col(1).norm());
  if (!(scale > 0.0) || !plane.allFinite()) return std::nullopt;
  plane /= plane(2, 2) < 0.0 ? -scale : scale;  // the target is in front of the camera
  Eigen::Matrix3d axes;
  axes << plane.col(0), plane.col(1), plane.col(0).cross(plane.col(1));
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(axes, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = svd.matrixU() * svd.matrixV().transpose();
  pose.translation() = plane.col(2);
  // In front of the camera, with its face towards it.
  const bool seen = pose.linear().col(2).dot(pose.translation()) > 0.0;
  if (!seen || pose.translation().z() <= 0.0) return std::nullopt;
  return pose;
}

}  // namespace

std::optional<PlanarPose> planarPose(const Eigen::Matrix3d& homography,
                                     const Covariance8& covariance, const Eigen::Matrix3d& camera,
                                     const cv::Size& reference_size, double target_width) {
  if (reference_size.empty()) throw std::invalid_argument("the reference image is empty");
  if (!(target_width > 0.0)) {
    throw std::invalid_argument("target width is " + std::to_string(target_width) +
                                "; expected more than 0 m");
  }
  if (!(camera(0, 0) > 0.0 && camera(1, 1) > 0.0)) {
    throw std::invalid_argument("focal length is " + std::to_string(camera(0, 0)) + ", " +
                                std::to_string(camera(1, 1)) + "; expected more than 0 px");
  }
  const Eigen::Matrix3d scale = targetFromReference(reference_size, target_width);
  const auto start = decomposed(homography, camera, scale);
  if (!start) return std::nullopt;
  PlanarPose result;
  result.target_to_camera = *start;
  result.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());

  // Entries of H differ in size by five orders of magnitude: each is in units of its own deviation.
  const Vector8 deviation = covariance.diagonal().cwiseSqrt();
  if (!deviation.allFinite() || !(deviation.minCoeff() > 0.0)) return result;
  const Covariance8 correlation =
      deviation.cwiseInverse().asDiagonal() * covariance * deviation.cwiseInverse().asDiagonal();
  const auto of_correlation = util::whiteningOf(correlation);
  if (!of_correlation) return result;
  const util::SmallMatrix whitening = *of_correlation * deviation.cwiseInverse().asDiagonal();
  const Vector8 wanted = entries(homography);
  Eigen::Isometry3d pose = *start;
  util::SmallMatrix rows;
  for (int iteration = 0; iteration < 10; ++iteration) {
    const Vector8 now = entries(homographyOf(pose, camera, scale));
    Matrix86 slope;
    for (int i = 0; i < 6; ++i) {
      constexpr double kStep = 1e-6;  // rad, and share of the distance
      const double size = i < 3 ? kStep * pose.translation().z() : kStep;
      const Vector6 step = size * Vector6::Unit(i);
      slope.col(i) = (entries(homographyOf(moved(pose, step), camera, scale)) -
                      entries(homographyOf(moved(pose, -step), camera, scale))) /
                     (2.0 * size);
    }
    rows = util::times(whitening, slope);
    const Vector8 rest = wanted - now;
    const Vector6 step = util::leastSquares(rows, util::times(whitening, rest)).solution;
    if (!step.allFinite() || step.tail<3>().norm() > 0.5) return result;
    pose = moved(pose, step);
    if (step.norm() < 1e-12 * (1.0 + pose.translation().norm())) break;
  }
  if (pose.translation().z() <= 0.0) return result;
  result.target_to_camera = pose;
  result.covariance = util::inverseOf(util::times(rows.transpose(), rows));
  return result;
}

}  // namespace ktgp_orb
