#include "motion/camera_pose.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <cmath>

namespace ktgp_orb::motion {

Eigen::Vector3d turnOf(const Eigen::Matrix3d& rotation) {
  const Eigen::AngleAxisd turn(rotation);
  return turn.angle() * turn.axis();
}

Eigen::Matrix3d aboutUp(double yaw) {
  return rotationAbout(yaw * Eigen::Vector3d::UnitZ());
}

double yawOf(const Eigen::Matrix3d& rotation) {
  return std::atan2(rotation(1, 0), rotation(0, 0));
}

Eigen::Matrix3d rotationBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d axis = from.cross(to);
  const double sine = axis.norm();
  const double cosine = from.dot(to);
  // If the directions are opposite, the cross product is mostly rounding error. Then half a turn
  // about any axis perpendicular to `from` turns it into `to`.
  const double least = cosine < 0.0 ? 1e-8 : 0.0;
  return rotationAbout(std::atan2(sine, cosine) *
                       (sine > least ? Eigen::Vector3d(axis / sine) : from.unitOrthogonal()));
}

CameraPose moved(const CameraPose& pose, const Vector6& step) {
  return {pose.axes * rotationAbout(step.tail<3>()), pose.position + step.head<3>()};
}

Eigen::Matrix3d imageFromGround(const CameraPose& pose) {
  Eigen::Matrix3d m = pose.axes.transpose();
  m.col(2) = -(pose.axes.transpose() * pose.position);
  return m;
}

std::optional<CameraPose> poseFrom(const Eigen::Matrix3d& image_from_ground) {
  const double scale = std::sqrt(image_from_ground.col(0).norm() * image_from_ground.col(1).norm());
  if (!image_from_ground.allFinite() || !(scale > 0.0)) return std::nullopt;
  const Eigen::Matrix3d m = image_from_ground / scale;
  Eigen::Matrix3d rows;
  rows << m.col(0), m.col(1), m.col(0).cross(m.col(1));
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(rows, Eigen::ComputeFullU | Eigen::ComputeFullV);
  CameraPose pose;
  pose.axes = (svd.matrixU() * svd.matrixV().transpose()).transpose();
  pose.position = -(pose.axes * m.col(2));
  // A negative height means that the homography's unknown factor is negative. Reversing its sign
  // negates the height and the first two rows of `axes`.
  if (pose.position.z() < 0.0) {
    pose.axes.topRows<2>() *= -1.0;
    pose.position.z() *= -1.0;
  }
  if (!(pose.position.z() > 0.0)) return std::nullopt;
  return pose;
}

Vector6 constantTwist(const CameraPose& from, const CameraPose& to) {
  const Eigen::Vector3d turn = turnOf(from.axes.transpose() * to.axes);
  const Eigen::Vector3d way = from.axes.transpose() * (to.position - from.position);
  const double angle = turn.norm();
  const double third =
      angle < 1e-3 ? 1.0 / 12.0 : 1.0 / (angle * angle) - 0.5 / (angle * std::tan(0.5 * angle));
  const Eigen::Vector3d bent = turn.cross(way);
  Vector6 twist;
  twist << way - 0.5 * bent + third * turn.cross(bent), turn;
  return twist;
}

Matrix612 twistSlope(const CameraPose& from, const CameraPose& to) {
  Matrix612 slope;
  for (int i = 0; i < 12; ++i) {
    const double size = i % 6 < 3 ? 1e-3 * to.position.z() : 1e-4;
    const Vector6 step = size * Vector6::Unit(i % 6);
    const auto twist_with = [&](const Vector6& change) {
      return i < 6 ? constantTwist(moved(from, change), to)
                   : constantTwist(from, moved(to, change));
    };
    slope.col(i) = (twist_with(step) - twist_with(-step)) / (2.0 * size);
  }
  return slope;
}

}  // namespace ktgp_orb::motion
