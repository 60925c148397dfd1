#include "motion/shutter.h"

#include <Eigen/LU>
#include <cmath>

#include "core/homography/transform.h"

namespace ktgp_orb::motion {
namespace {

/// Velocity of the picture at a point.
Eigen::Vector2d velocityAt(const Eigen::Matrix3d& flow, const Eigen::Vector2d& point) {
  const Eigen::Vector3d change = flow * point.homogeneous();
  return change.head<2>() - change.z() * point;
}

}  // namespace

Vector8 Shutter::add(const Eigen::Matrix3d& homography, std::int64_t stamp,
                     std::int64_t reference_stamp, const cv::Size& size,
                     const Eigen::Matrix3d& camera) {
  const bool same_reference = reference_stamp == reference_stamp_ && stamp_ != 0;
  const bool follows = reference_stamp == stamp_;
  const std::int64_t since = same_reference ? stamp_ : reference_stamp;
  const Eigen::Matrix3d motion =
      same_reference ? Eigen::Matrix3d(homography * homography_.inverse()) : homography;
  const Eigen::Matrix3d step = motion / std::cbrt(motion.determinant());
  const double seconds = 1e-9 * static_cast<double>(stamp - since);
  const Eigen::Matrix3d flow = (step - step.inverse()) / (2.0 * seconds);
  if (!same_reference) reference_flow_ = follows && !flow_.isZero() ? flow_ : flow;
  flow_ = flow;
  stamp_ = stamp;
  reference_stamp_ = reference_stamp;
  homography_ = homography;
  if (size.empty() || !flow.allFinite()) return Vector8::Zero();

  // Least squares over a grid of points of the reference that the frame shows.
  constexpr int kGrid = 7;
  const double middle = (0.5 * (size.height - 1) - camera(1, 2)) / camera(1, 1);
  const double share_of_row = camera(1, 1) / size.height;  // of the readout time
  Matrix8 information = Matrix8::Zero();
  Vector8 sum = Vector8::Zero();
  int count = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const int column = i % kGrid, row = i / kGrid;
    const Eigen::Vector2d pixel((column + 0.5) / kGrid * size.width,
                                (row + 0.5) / kGrid * size.height);
    const Eigen::Vector2d from((pixel.x() - camera(0, 2)) / camera(0, 0),
                               (pixel.y() - camera(1, 2)) / camera(1, 1));
    const Eigen::Vector2d to = homography::project(homography, from);
    const Eigen::Vector2d seen(to.x() * camera(0, 0) + camera(0, 2),
                               to.y() * camera(1, 1) + camera(1, 2));
    if (!(seen.x() > 0.0 && seen.x() < size.width && seen.y() > 0.0 && seen.y() < size.height)) {
      continue;
    }
    const double late_to = share_of_row * (to.y() - middle);
    const double late_from = share_of_row * (from.y() - middle);
    const Eigen::Vector2d wanted = homography::jacobianByPoint(homography, from) *
                                       (late_from * velocityAt(reference_flow_, from)) -
                                   late_to * velocityAt(flow_, to);
    const Eigen::Matrix<double, 2, 8> slope = homography::jacobianByEntries(homography, from);
    information += slope.transpose() * slope;
    sum += slope.transpose() * wanted;
    ++count;
  }
  if (count < 8) return Vector8::Zero();
  const Vector8 change = information.ldlt().solve(sum);
  return change.allFinite() ? change : Vector8::Zero();
}

}  // namespace ktgp_orb::motion
