#include "motion/rows.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>

namespace ktgp_orb::motion {
namespace {

// Minimum standard deviation of a reading, as a share of the height or in rad, since a reading may
// claim to be exact.
constexpr double kLeastDeviation = 1e-6;

// Minimum drop of a range sensor's beam per metre of its length. A flatter beam shows the height
// badly or not at all.
constexpr double kLeastSink = 0.1;

/// Change of the first eight entries of h if h changes by d and is then normalised to h(2,2) = 1.
Vector8 entriesChange(const Eigen::Matrix3d& h, const Eigen::Matrix3d& d) {
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> change = d - d(2, 2) * h;
  return Eigen::Map<const Vector8>(change.data());
}

/// The matrix whose entry `i` (counted row by row) is 1 and whose other entries are 0.
Eigen::Matrix3d unit(int i) {
  Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
  m(i / 3, i % 3) = 1.0;
  return m;
}

/// The direction from the camera to the ground, in the camera's frame.
Eigen::Vector3d downOf(const CameraPose& pose) {
  return -pose.axes.row(2).transpose();
}

}  // namespace

ImageMotion inImageUnits(const Eigen::Matrix3d& homography, const Covariance8& covariance,
                         const Eigen::Matrix3d& camera) {
  const Eigen::Matrix3d inverse = camera.inverse();
  const Eigen::Matrix3d h = inverse * (homography / homography(2, 2)) * camera;
  ImageMotion motion;
  motion.homography = h / h(2, 2);
  Matrix8 slope;
  for (int i = 0; i < 8; ++i) {
    slope.col(i) =
        entriesChange(motion.homography, inverse.col(i / 3) * camera.row(i % 3) / h(2, 2));
  }
  // For simulated images without noise, the covariance is nearly 0. The linearisation errors of the
  // filter are then larger than the noise, and its covariance would become indefinite. So a small
  // variance is added.
  constexpr double kLeast = 1e-6;  // share of the focal length: 0.0005 px for 500 px
  motion.covariance = slope * covariance * slope.transpose();
  motion.covariance.diagonal().array() += kLeast * kLeast;
  return motion;
}

Matrix86 byPose(const Eigen::Matrix3d& h, const Eigen::Matrix3d& map, const CameraPose& pose) {
  const Eigen::Matrix3d q = h / h(2, 2);
  Matrix86 slope;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d axis = Eigen::Vector3d::Unit(i);
    slope.col(i) = entriesChange(q, -pose.axes.row(i).transpose() * (map.row(2) / h(2, 2)));
    slope.col(3 + i) = entriesChange(q, -crossed(axis) * q);
  }
  return slope;
}

Matrix8 byMap(const Eigen::Matrix3d& h) {
  const Eigen::Matrix3d q = h / h(2, 2);
  Matrix8 slope;
  for (int i = 0; i < 8; ++i) slope.col(i) = entriesChange(q, q * unit(i));
  return slope;
}

Matrix8 mapFromEntries(const Eigen::Matrix3d& h) {
  const Eigen::Matrix3d inverse = (h / h(2, 2)).inverse();
  Matrix8 slope;
  for (int i = 0; i < 8; ++i) {
    slope.col(i) = entriesChange(Eigen::Matrix3d::Identity(), inverse * unit(i));
  }
  return slope;
}

bool looksDown(const Eigen::Vector3d& down) {
  // The camera looks below the horizon if the cosine of the angle between its optical axis and the
  // direction to the ground is larger than this.
  constexpr double kHorizon = 0.1;
  return down.z() > kHorizon;
}

bool meetsGround(const HeightReading& reading, const Eigen::Vector3d& down) {
  return reading.beam_direction.isZero() || reading.beam_direction.dot(down) >= kLeastSink;
}

bool meetsGround(const HeightReading& reading, const CameraPose& pose) {
  return meetsGround(reading, downOf(pose));
}

PoseRows<1> rowsOf(const HeightReading& reading, const CameraPose& pose, double rise) {
  PoseRows<1> rows;
  rows.deviation = std::hypot(reading.deviation, kLeastDeviation * reading.metres);
  const Eigen::RowVector3d up = pose.axes.row(2);  // the upward direction in the camera's frame
  if (reading.beam_direction.isZero()) {
    rows.residual(0) = reading.metres + rise * reading.age - pose.position.z();
    rows.slope(2) = 1.0;
    return rows;
  }
  if (!meetsGround(reading, pose)) {
    rows.residual(0) = std::numeric_limits<double>::infinity();
    return rows;
  }
  // How far the beam drops per metre of its length.
  const double sinks = reading.beam_direction.dot(downOf(pose));
  const double start = pose.position.z() + up.dot(reading.beam_origin);
  const double length = start / sinks;
  rows.residual(0) = reading.metres + rise * reading.age / sinks - length;
  rows.slope(2) = 1.0 / sinks;
  rows.slope.tail<3>() =
      -(up * crossed(reading.beam_origin) + length * up * crossed(reading.beam_direction)) / sinks;
  return rows;
}

PoseRows<3> rowsOf(const DownReading& reading, const CameraPose& pose) {
  const Eigen::Vector3d down = downOf(pose);
  PoseRows<3> rows;
  rows.deviation = std::hypot(reading.deviation, kLeastDeviation);
  rows.residual = reading.direction - down;
  rows.slope << Eigen::Matrix3d::Zero(), crossed(down);
  return rows;
}

CameraPose onGround(const GroundFrame& frame, const CameraPose& pose,
                    const Eigen::Vector3d& lever) {
  CameraPose placed = pose;
  const Eigen::Vector3d base = pose.position + pose.axes * lever;
  if (frame.down) {
    placed.axes = pose.axes * rotationBetween(frame.down->direction, downOf(pose));
  }
  placed.position.head<2>() = (base - placed.axes * lever).head<2>();
  if (frame.height && meetsGround(*frame.height, placed)) {
    const PoseRows<1> rows = rowsOf(*frame.height, placed, 0.0);
    placed.position.z() += rows.residual(0) / rows.slope(2);
  }
  return placed;
}

CameraPose firstPose(const GroundFrame& frame, const Pose3& camera_to_base) {
  CameraPose pose;
  pose.axes = camera_to_base.linear();
  pose.position.z() = frame.height->metres;
  // A camera that sees the ground does not look at the sky, so `camera_to_base` is not the mounting
  // on a level base (for example the default, the identity). From a pose with the ground behind the
  // camera, the filter would find the mirrored motion.
  if (!frame.down && !looksDown(downOf(pose))) {
    pose.axes *= rotationBetween(Eigen::Vector3d::UnitZ(), downOf(pose));
  }
  const Pose3 base_to_camera = camera_to_base.inverse();
  pose = onGround(frame, pose, base_to_camera.translation());
  pose.axes = aboutUp(-yawOf(pose.axes * base_to_camera.linear())) * pose.axes;
  pose.position.head<2>() = -(pose.axes * base_to_camera.translation()).head<2>();
  return pose;
}

PoseRows<3> rowsOf(const TurnReading& reading, const CameraPose& pose, const CameraPose& before) {
  const Eigen::Matrix3d predicted = before.axes.transpose() * pose.axes;
  PoseRows<3> rows;
  rows.deviation = std::hypot(reading.deviation, kLeastDeviation);
  rows.residual = turnOf(predicted.transpose() * reading.rotation);
  rows.slope << Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Identity();
  rows.slope_before << Eigen::Matrix3d::Zero(), -predicted.transpose();
  return rows;
}

}  // namespace ktgp_orb::motion
