#include "two_view/motions.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <optional>

#include "homography/transform.h"
#include "util/geometry.h"
#include "util/small_matrix.h"

namespace ktgp_orb::two_view {
namespace {

Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d r = svd.matrixU() * svd.matrixV().transpose();
  if (r.determinant() < 0.0) r = -r;
  return r;
}

/// Returns the change of the first eight entries of `homography`, scaled so that its last entry
/// stays 1, that `change` of the whole matrix causes.
Eigen::Matrix<double, 8, 1> changeOfEntries(const Eigen::Matrix3d& homography,
                                            const Eigen::Matrix3d& change) {
  const double last = homography(2, 2);
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rows =
      (change - change(2, 2) / last * homography) / last;
  return Eigen::Map<const Eigen::Matrix<double, 8, 1>>(rows.data());
}

}  // namespace

std::vector<PlanarMotion> planarMotions(const PointPairs& pairs,
                                        const std::vector<std::uint8_t>& mask,
                                        const Cameras& cameras, const Eigen::Matrix3d& homography) {
  // In units of the plane's distance; a shorter translation is a rounding error.
  constexpr double kLeast = 1e-9;
  cv::Matx33d calibrated;
  cv::eigen2cv(Eigen::Matrix3d(cameras.target_inverse * homography * cameras.reference),
               calibrated);
  std::vector<cv::Mat> rotations;
  std::vector<cv::Mat> translations;
  std::vector<cv::Mat> normals;
  cv::decomposeHomographyMat(calibrated, cv::Matx33d::eye(), rotations, translations, normals);
  std::vector<PlanarMotion> motions;
  for (std::size_t k = 0; k < rotations.size(); ++k) {
    PlanarMotion motion;
    cv::cv2eigen(rotations[k], motion.rotation);
    cv::cv2eigen(translations[k], motion.translation);
    cv::cv2eigen(normals[k], motion.normal);
    if (!(motion.translation.norm() > kLeast) || !(motion.rotation.determinant() > 0.0)) continue;
    std::size_t front = 0;
    std::size_t all = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      if (mask[i] == 0) continue;
      front += motion.normal.dot(cameras.referenceRay(pairs.reference[i])) > 0.0;
      ++all;
    }
    if (2 * front >= all) motions.push_back(motion);
  }
  return motions;
}

Covariance6 covarianceOf(const PlanarMotion& motion, const Cameras& cameras,
                         const Eigen::Matrix<double, 8, 8>& of_homography) {
  // Jacobian of the first eight entries of H, scaled so that the last entry is 1, with respect to
  // the rotation (3 columns), the direction (2) and length (1) of the translation, and the normal
  // (2).
  const double length = motion.translation.norm();
  const Eigen::Vector3d direction = motion.translation / length;
  const Eigen::Matrix<double, 3, 2> around = across(direction);
  const Eigen::Matrix<double, 3, 2> tilts = across(motion.normal);
  const Eigen::Matrix3d product = motion.rotation + motion.translation * motion.normal.transpose();
  const Eigen::Matrix3d h = cameras.target * product * cameras.reference_inverse;
  Eigen::Matrix<double, 8, 8> by_motion;
  const auto set = [&](int column, const Eigen::Matrix3d& change) {
    by_motion.col(column) = changeOfEntries(h, cameras.target * change * cameras.reference_inverse);
  };
  for (int i = 0; i < 3; ++i) set(i, crossed(Eigen::Vector3d::Unit(i)) * motion.rotation);
  for (int i = 0; i < 2; ++i) set(3 + i, length * around.col(i) * motion.normal.transpose());
  set(5, motion.translation * motion.normal.transpose());
  for (int i = 0; i < 2; ++i) set(6 + i, motion.translation * tilts.col(i).transpose());
  const Eigen::Matrix<double, 8, 8> back = by_motion.inverse();
  const Eigen::Matrix<double, 8, 8> covariance = back * of_homography * back.transpose();
  return poseCovariance(covariance.topLeftCorner<5, 5>(), direction);
}

SharedShifts::Columns<8> sharedChanges(const PointPairs& pairs,
                                       const std::vector<std::uint8_t>& mask,
                                       const Eigen::Matrix3d& homography,
                                       const SharedShifts& shared) {
  Eigen::Matrix<double, 8, 8> squares = Eigen::Matrix<double, 8, 8>::Zero();
  SharedShifts::Columns<8> pulls = SharedShifts::Columns<8>::Zero();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (mask[i] == 0) continue;
    const Eigen::Matrix<double, 2, 8> by_entries =
        homography::jacobianByEntries(homography, pairs.reference[i]);
    squares += by_entries.transpose() * by_entries;
    pulls += by_entries.transpose() * shared.at(pairs.reference[i], pairs.target[i], homography);
  }
  // The entries of a homography differ much in size, so the system is scaled before it is solved.
  const Eigen::Matrix<double, 8, 1> scale = squares.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::Matrix<double, 8, 8> scaled = scale.asDiagonal() * squares * scale.asDiagonal();
  const util::SmallMatrix inverse = util::inverseOf(scaled);
  return scale.asDiagonal() * inverse * (scale.asDiagonal() * pulls);
}

Eigen::Matrix3d changed(const Eigen::Matrix3d& homography,
                        const Eigen::Matrix<double, 8, 1>& change) {
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rows = homography / homography(2, 2);
  Eigen::Map<Eigen::Matrix<double, 8, 1>>(rows.data()) += change;
  return rows;
}

namespace {

/// Derivative of the first eight entries of `h`, the homography of `rotation`, with respect to
/// small rotations about the target camera's axes.
Eigen::Matrix<double, 8, 3> entriesByTurn(const Eigen::Matrix3d& h, const Cameras& cameras,
                                          const Eigen::Matrix3d& rotation) {
  Eigen::Matrix<double, 8, 3> by_turn;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Matrix3d change = crossed(Eigen::Vector3d::Unit(i)) * rotation;
    by_turn.col(i) = changeOfEntries(h, cameras.target * change * cameras.reference_inverse);
  }
  return by_turn;
}

}  // namespace

std::optional<double> sidewaysOf(const Eigen::Matrix3d& homography,
                                 const Eigen::Matrix<double, 8, 8>& covariance,
                                 const Cameras& cameras, const Eigen::Matrix3d& rotation) {
  const std::optional<util::SmallMatrix> whitening = util::whiteningOf(covariance);
  if (!whitening) return std::nullopt;
  const Eigen::Matrix3d h = cameras.homographyOf(rotation);
  Eigen::Matrix<double, 8, 5> by_motion;
  by_motion.leftCols<3>() = entriesByTurn(h, cameras, rotation);
  for (int i = 0; i < 2; ++i) {
    const Eigen::Matrix3d change = Eigen::Vector3d::Unit(i) * Eigen::RowVector3d::UnitZ();
    by_motion.col(3 + i) = changeOfEntries(h, cameras.target * change * cameras.reference_inverse);
  }
  const Eigen::Matrix<double, 8, 1> off = util::entriesOf(homography) - util::entriesOf(h);
  const util::SmallMatrix slope = *whitening * by_motion;
  const util::SmallMatrix motion = util::leastSquares(slope, *whitening * off).solution;
  const util::SmallMatrix unsure = util::inverseOf(slope.transpose() * slope);
  return std::sqrt(0.5 *
                   (motion(3) * motion(3) + motion(4) * motion(4) + unsure(3, 3) + unsure(4, 4)));
}

double shearOf(const Eigen::Matrix3d& homography, const Cameras& cameras,
               const Eigen::Matrix3d& rotation) {
  const Eigen::Matrix3d rest =
      cameras.target_inverse * homography * cameras.reference * rotation.transpose();
  return 0.5 * std::hypot(rest(0, 0) - rest(1, 1), rest(0, 1) + rest(1, 0)) / std::abs(rest(2, 2));
}

std::optional<NearestTurn> nearestTurn(const Eigen::Matrix3d& homography,
                                       const Eigen::Matrix<double, 8, 8>& covariance,
                                       const Cameras& cameras, const Eigen::Matrix3d& start) {
  constexpr int kRounds = 3;  // enough, since the start is usually less than a degree away
  const std::optional<util::SmallMatrix> whitening = util::whiteningOf(covariance);
  if (!whitening) return std::nullopt;
  NearestTurn nearest{start, Eigen::Matrix3d::Zero()};
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::Matrix3d h = cameras.homographyOf(nearest.rotation);
    const Eigen::Matrix<double, 8, 1> off = util::entriesOf(homography) - util::entriesOf(h);
    const Eigen::Matrix<double, 8, 3> slope =
        *whitening * entriesByTurn(h, cameras, nearest.rotation);
    const util::LeastSquares step = util::leastSquares(slope, *whitening * off);
    nearest.rotation = turned(step.solution, nearest.rotation);
    nearest.covariance = (slope.transpose() * slope).inverse();
    nearest.distance2 = step.rest.squaredNorm();
  }
  return nearest;
}

void RotationProblem::evaluate(std::size_t i, const State& rotation, Eigen::Vector2d& residual,
                               Eigen::Matrix<double, 2, 3>& jacobian) const {
  const Eigen::Matrix3d& k = cameras->target;
  const Eigen::Vector3d p = rotation * rays[i];
  residual = precision[i] * ((k * p).hnormalized() - targets[i]);
  Eigen::Matrix<double, 2, 3> by_point;
  by_point << k(0, 0) / p.z(), k(0, 1) / p.z(),
      -(k(0, 0) * p.x() + k(0, 1) * p.y()) / (p.z() * p.z()), 0.0, k(1, 1) / p.z(),
      -k(1, 1) * p.y() / (p.z() * p.z());
  jacobian = -precision[i] * by_point * crossed(p);
}

bool RotationFit::fit(const PointPairs& pairs, const Cameras& cameras,
                      const Eigen::Matrix3d& homography, std::size_t inliers, double max_error,
                      const std::vector<double>* deviations) {
  constexpr int kRounds = 3;
  constexpr double kReach = 2.0;  // as a multiple of max_error; worse pairs are left out
  estimation::FitRules rules;
  rules.longest = 1.0;       // rad
  rules.least_scale = 1e-4;  // px
  rotation_ = nearestRotation(cameras.target_inverse * homography * cameras.reference);
  problem_.cameras = &cameras;
  fit_.weights().setScale(0.5 * max_error);
  for (int round = 0; round < kRounds; ++round) {
    problem_.rays.clear();
    problem_.targets.clear();
    problem_.precision.clear();
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const Eigen::Vector3d ray = cameras.referenceRay(pairs.reference[i]);
      const Eigen::Vector3d p = rotation_ * ray;
      if (!(p.z() > 1e-6)) continue;
      const double error = ((cameras.target * p).hnormalized() - pairs.target[i]).norm();
      if (!(error < kReach * max_error)) continue;
      problem_.rays.push_back(ray);
      problem_.targets.push_back(pairs.target[i]);
      problem_.precision.push_back(deviations == nullptr ? 1.0 : 1.0 / (*deviations)[i]);
    }
    if (size() <= 4 || 2 * size() < inliers) return false;
    fit_.weights().reset(size(), 2, 3);
    if (fit_.minimise(problem_, rules, rotation_) == estimation::FitEnd::undetermined &&
        !estimation::breadOf(fit_.sums()).allFinite()) {
      return false;
    }
  }
  rotation_ = nearestRotation(rotation_);
  return true;
}

Eigen::Matrix3d RotationFit::covariance(const SharedShifts& shared, double unseen) const {
  // An undetected translation shifts all points in the same way, as a rotation does.
  const Eigen::Matrix2d moved = unseen * Eigen::Matrix2d::Identity();
  const Eigen::Matrix3d h = problem_.cameras->homographyOf(rotation_);
  SharedShifts::Columns<3> by_shared = SharedShifts::Columns<3>::Zero();
  Eigen::Matrix<double, 3, 2> by_move = Eigen::Matrix<double, 3, 2>::Zero();
  Eigen::Vector2d residual;
  Eigen::Matrix<double, 2, 3> jacobian;
  for (std::size_t i = 0; i < size(); ++i) {
    problem_.evaluate(i, rotation_, residual, jacobian);
    jacobian *= fit_.weights().weight[i] * problem_.precision[i];
    const Eigen::Vector2d x = (problem_.cameras->reference * problem_.rays[i]).hnormalized();
    by_shared += jacobian.transpose() * shared.at(x, problem_.targets[i], h);
    by_move += jacobian.transpose() * moved;
  }
  const estimation::Information bread = estimation::breadOf(fit_.sums());
  const estimation::Information meat = estimation::independentMeat(fit_.sums(), fit_.weights()) +
                                       by_shared * by_shared.transpose() +
                                       by_move * by_move.transpose();
  return estimation::sandwich(bread, meat);
}

std::optional<RelativePose> reversedInDepth(const EpipolarPairs& pairs, const Epipolar& geometry) {
  Eigen::Vector3d from = Eigen::Vector3d::Zero();
  Eigen::Vector3d to = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (!(pairs.distance(geometry, i) < pairs.limit)) continue;
    from += pairs.referenceRay(i).normalized();
    to += pairs.targetRay(i).normalized();
  }
  if (from.isZero(0.0) || to.isZero(0.0)) return std::nullopt;
  from.normalize();
  to.normalize();
  constexpr double kParallel = 1e-9;  // squared sine of the angle between the rays
  // The middle of the scene has the distances z[0] and z[1]: z[1] to = z[0] R from + t.
  const Eigen::Matrix3d& turn = geometry.motion.rotation;
  Eigen::Matrix<double, 3, 2> rays;
  rays << -turn * from, to;
  const Eigen::Matrix2d squares = rays.transpose() * rays;
  if (!(squares.determinant() > kParallel)) return std::nullopt;
  const Eigen::Vector2d z = squares.inverse() * rays.transpose() * geometry.motion.translation;
  const auto mirror = [](const Eigen::Vector3d& ray) -> Eigen::Matrix3d {
    return Eigen::Matrix3d::Identity() - 2.0 * ray * ray.transpose();
  };
  RelativePose pose;
  pose.rotation = mirror(to) * turn * mirror(from);
  pose.translation = (z[1] * to - z[0] * pose.rotation * from).normalized();
  return pose;
}

Eigen::Matrix3d turnOf(const EpipolarPairs& pairs) {
  constexpr int kRounds = 5;          // the first two rounds give all pairs nearly the same weight
  constexpr std::size_t kMost = 200;  // best pairs
  constexpr double kLeastScale2 = 1e-18;  // rad²; not 0, because all residuals may be zero
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

}  // namespace ktgp_orb::two_view
