#pragma once

#include <Eigen/Geometry>

namespace ktgp_orb::util {

/// The matrix [v]x of the cross product with v: crossed(v) * w = v × w.
inline Eigen::Matrix3d crossed(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(),  //
      v.z(), 0.0, -v.x(),   //
      -v.y(), v.x(), 0.0;
  return m;
}

/// The rotation about the direction of `turn` by the angle |turn|, rad.
inline Eigen::Matrix3d rotationAbout(const Eigen::Vector3d& turn) {
  const double angle = turn.norm();
  if (angle == 0.0) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
}

/// The first eight entries of the homography h, scaled so that h(2,2) is 1, row by row.
inline Eigen::Matrix<double, 8, 1> entriesOf(const Eigen::Matrix3d& h) {
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rows = h / h(2, 2);
  return Eigen::Map<const Eigen::Matrix<double, 8, 1>>(rows.data());
}

}  // namespace ktgp_orb::util
