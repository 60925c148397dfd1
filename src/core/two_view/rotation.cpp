#include "core/two_view/rotation.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <limits>

#include "core/two_view/epipolar.h"

namespace ktgp_orb::two_view {
namespace {

Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d r = svd.matrixU() * svd.matrixV().transpose();
  if (r.determinant() < 0.0) r = -r;
  return r;
}

}  // namespace

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
                 std::size_t inliers, double max_error, UncertainRotation& result) {
  constexpr int kSteps = 8;
  constexpr double kFreedom = 4.0;  // of Student's t
  constexpr double kEntries = 3.0;
  Eigen::Matrix3d& rotation = result.rotation;
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
    result.covariance = n / (n - kEntries) * bread * pulls * bread.transpose();
    scale2 = std::max(n / (n - kEntries) * cost / (2.0 * weights), 1e-8);
  }
  rotation = nearestRotation(rotation);
  return true;
}

}  // namespace ktgp_orb::two_view
