#include "motion/shutter.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "homography/transform.h"
#include "util/small_matrix.h"

namespace ktgp_orb::motion {
namespace {

/// Returns the flow that the matrix m represents (see Shutter::flow_). For this, subtracts a
/// multiple of the identity, so that entry (2,2) becomes zero, and returns the other eight entries.
/// The flow stays the same, because a multiple of the identity moves no point.
Vector8 flowOf(const Eigen::Matrix3d& m) {
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rows =
      m - m(2, 2) * Eigen::Matrix3d::Identity();
  return Eigen::Map<const Vector8>(rows.data());
}

/// Jacobian of flowOf(H * m) with respect to the first eight entries of the homography H.
Matrix8 flowByEntries(const Eigen::Matrix3d& m) {
  Matrix8 slope;
  for (int i = 0; i < 8; ++i) {
    Eigen::Matrix3d unit = Eigen::Matrix3d::Zero();
    unit(i / 3, i % 3) = 1.0;
    slope.col(i) = flowOf(unit * m);
  }
  return slope;
}

/// Image velocity (optical flow) at `point`, for a focal length of 1.
Eigen::Vector2d velocityAt(const Vector8& flow, const Eigen::Vector2d& point) {
  return homography::jacobianByEntries(Eigen::Matrix3d::Identity(), point) * flow;
}

}  // namespace

Vector8 Shutter::add(const ImageMotion& motion, std::int64_t stamp, std::int64_t reference_stamp,
                     const cv::Size& size, const Eigen::Matrix3d& camera) {
  const Eigen::Matrix3d& homography = motion.homography;
  const bool same_reference = has_frame_ && reference_stamp == reference_stamp_;
  const bool follows = has_frame_ && reference_stamp == stamp_;
  const std::int64_t since = same_reference ? stamp_ : reference_stamp;
  const Eigen::Matrix3d back =
      same_reference ? Eigen::Matrix3d(motion_.homography.inverse()) : Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d both = homography * back;
  const Eigen::Matrix3d step = both / std::cbrt(both.determinant());
  const double seconds = 1e-9 * static_cast<double>(stamp - since);
  const Vector8 seen = flowOf((step - step.inverse()) / (2.0 * seconds));
  Matrix8 covariance = motion.covariance;
  if (same_reference) covariance = kOfFrame * (covariance + motion_.covariance);
  const Matrix8 slope = flowByEntries(back) / seconds;
  if (!same_reference && !follows) changes_ = 0.0;
  if (!same_reference && follows) reference_flow_ = flow_;
  // If an earlier stamp was ahead of its time, `seconds` is not positive; then no flow is computed.
  if (seconds > 0.0) follow(seen, slope * covariance * slope.transpose());
  if (!same_reference && !follows) reference_flow_ = flow_;
  has_frame_ = true;
  stamp_ = stamp;
  reference_stamp_ = reference_stamp;
  motion_ = motion;
  if (size.empty() || !flow_.allFinite()) return Vector8::Zero();
  return correction(size, camera);
}

/// Fits the correction of the newest homography by least squares to the shifts of a grid of points
/// in the reference. Points that the frame does not show are left out.
Vector8 Shutter::correction(const cv::Size& size, const Eigen::Matrix3d& camera) const {
  constexpr int kGrid = 7;
  const Eigen::Matrix3d& homography = motion_.homography;
  const double middle = (0.5 * (size.height - 1) - camera(1, 2)) / camera(1, 1);
  // How much later a row is exposed, as a share of the readout time, if its y (at focal length 1)
  // is larger by 1.
  const double share_of_row = camera(1, 1) / size.height;
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
    const Eigen::Vector2d shown(to.x() * camera(0, 0) + camera(0, 2),
                                to.y() * camera(1, 1) + camera(1, 2));
    if (!(shown.x() > 0.0 && shown.x() < size.width && shown.y() > 0.0 &&
          shown.y() < size.height)) {
      continue;
    }
    const double late_to = share_of_row * (to.y() - middle);
    const double late_from = share_of_row * (from.y() - middle);
    const Eigen::Vector2d wanted = homography::jacobianByPoint(homography, from) *
                                       (late_from * velocityAt(reference_flow_, from)) -
                                   late_to * velocityAt(flow_, to);
    const Eigen::Matrix<double, 2, 8> by_entries = homography::jacobianByEntries(homography, from);
    information += by_entries.transpose() * by_entries;
    sum += by_entries.transpose() * wanted;
    ++count;
  }
  if (count < 8) return Vector8::Zero();
  const Vector8 change = information.ldlt().solve(sum);
  return change.allFinite() ? change : Vector8::Zero();
}

/// Updates flow_, which varies slowly, with a Kalman filter. The filter learns its gain from
/// change_: along each eigenvector of change_, the gain is 0 if noise alone may explain the
/// eigenvalue; otherwise the gain grows with the eigenvalue.
void Shutter::follow(const Vector8& seen, const Matrix8& noise) {
  constexpr double kMemory = 64.0;
  const Eigen::LLT<Matrix8> root(noise);
  if (changes_ == 0.0 || root.info() != Eigen::Success || !flow_.allFinite()) {
    flow_ = seen;
    change_.setZero();
    changes_ = 1.0;
    return;
  }
  const Vector8 change = root.matrixL().solve(seen - flow_);
  change_ += (change * change.transpose() - change_) / changes_;
  // Approximate largest eigenvalue of change_ if all changes are noise (Marchenko and Pastur).
  const double of_noise = std::pow(1.0 + std::sqrt(8.0 / changes_), 2);
  changes_ = std::min(changes_ + 1.0, kMemory);
  const util::Eigenpairs axes = util::eigenpairsOf(change_);
  const Vector8 gain = axes.values.unaryExpr(
      [=](double square) { return square > of_noise ? 1.0 - 1.0 / square : 0.0; });
  const Vector8 along = util::times(axes.vectors.transpose(), change);
  flow_ += root.matrixL() * Vector8(util::times(axes.vectors, gain.cwiseProduct(along)));
}

}  // namespace ktgp_orb::motion
