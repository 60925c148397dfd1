#include "two_view/epipolar.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace ktgp_orb::two_view {
namespace {

constexpr double kFreedom = 4.0;    // of Student's t, as for homographies
constexpr double kFarLimits = 2.0;  // of Sampson distances: the limit of reprojection errors

/// Sampson distance of a pair: C / n with C = x'^T F x and n the length of C's derivative by the
/// four coordinates. `a` and `b`: derivatives of C by target and reference.
template <typename Value>
struct Sampson {
  Value a0, a1, b0, b1;
  Value value;    // C
  Value length2;  // n²

  template <typename Entries>
  Sampson(const Entries& f, const Value& x, const Value& y, const Value& u, const Value& v)
      : a0(f(0, 0) * x + f(0, 1) * y + f(0, 2)),
        a1(f(1, 0) * x + f(1, 1) * y + f(1, 2)),
        b0(f(0, 0) * u + f(1, 0) * v + f(2, 0)),
        b1(f(0, 1) * u + f(1, 1) * v + f(2, 1)),
        value(u * a0 + v * a1 + f(2, 0) * x + f(2, 1) * y + f(2, 2)),
        length2(a0 * a0 + a1 * a1 + b0 * b0 + b1 * b1) {}
};

using Points = homography::PointArrays<float>;

Points::Lanes squaredErrors(const Points& p, const Eigen::Matrix3f& f, std::size_t first) {
  constexpr float kTiny = 1e-30F;  // the length at the epipoles
  const Sampson<Points::Lanes> s(f, Points::load(p.x, first), Points::load(p.y, first),
                                 Points::load(p.u, first), Points::load(p.v, first));
  return s.value * s.value / s.length2.max(kTiny);
}

Eigen::Matrix<double, 9, 1> rowByRow(const Eigen::Matrix3d& m) {
  Eigen::Matrix<double, 9, 1> rows;
  rows << m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2);
  return rows;
}

Eigen::Matrix3d productOf(const Epipolar& g) {
  return g.u * Eigen::Vector3d(1.0, g.s, 0.0).asDiagonal() * g.v.transpose();
}

}  // namespace

Eigen::Matrix<double, 3, 2> across(const Eigen::Vector3d& direction) {
  Eigen::Index least = 0;
  direction.cwiseAbs().minCoeff(&least);
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = direction.cross(Eigen::Vector3d::Unit(least)).normalized();
  basis.col(1) = direction.cross(basis.col(0));
  return basis;
}

Eigen::Matrix3d turned(const Eigen::Vector3d& rotation, const Eigen::Matrix3d& matrix) {
  if (!(rotation.norm() > 0.0)) return matrix;
  return util::rotationAbout(rotation) * matrix;
}

void EpipolarPairs::load(const PointPairs& pairs, const estimation::QualityOrder& order,
                         double max_error, const std::optional<Cameras>& cameras) {
  const auto by_quality = [&order](std::size_t place) { return order[place]; };
  NormalisedPairs::load(pairs.reference, pairs.target, by_quality, max_error, true);
  calibrated_ = cameras.has_value();
  reference_ray_ = target_ray_ = Eigen::Matrix3d::Identity();
  focal_ = 1.0;
  if (calibrated_) {
    focal_ = scale() * std::sqrt(cameras->target(0, 0) * cameras->target(1, 1));
    reference_ray_ = (reference.matrix() * cameras->reference).inverse();
    target_ray_ = (target.matrix() * cameras->target).inverse();
  }
}

Epipolar EpipolarPairs::fromMotion(const RelativePose& motion) const {
  Epipolar geometry;
  geometry.motion = motion;
  geometry.matrix = fundamentalOf(crossed(motion.translation) * motion.rotation);
  return geometry;
}

Epipolar EpipolarPairs::fromMatrix(const Eigen::Matrix3d& normalised) const {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(normalised,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  Epipolar geometry;
  geometry.u = svd.matrixU();
  geometry.v = svd.matrixV();
  if (geometry.u.determinant() < 0.0) geometry.u.col(2) *= -1.0;
  if (geometry.v.determinant() < 0.0) geometry.v.col(2) *= -1.0;
  geometry.s = svd.singularValues()[1] / svd.singularValues()[0];
  geometry.matrix = productOf(geometry);
  return geometry;
}

Eigen::Matrix3d EpipolarPairs::inPixels(const Epipolar& geometry) const {
  const Eigen::Matrix3d f = target.matrix().transpose() * geometry.matrix * reference.matrix();
  return f / f.norm();
}

EpipolarPairs::Tangent EpipolarPairs::tangent(const Epipolar& g) const {
  Tangent columns(9, freedom());
  if (calibrated_) {
    const Eigen::Matrix3d cross = crossed(g.motion.translation);
    const Eigen::Matrix<double, 3, 2> directions = across(g.motion.translation);
    for (int i = 0; i < 3; ++i) {
      columns.col(i) =
          rowByRow(fundamentalOf(cross * crossed(Eigen::Vector3d::Unit(i)) * g.motion.rotation));
    }
    for (int i = 0; i < 2; ++i) {
      columns.col(3 + i) = rowByRow(fundamentalOf(crossed(directions.col(i)) * g.motion.rotation));
    }
    return columns;
  }
  for (int i = 0; i < 3; ++i) {
    const Eigen::Matrix3d axis = crossed(Eigen::Vector3d::Unit(i));
    columns.col(i) = rowByRow(axis * g.matrix);
    columns.col(3 + i) = rowByRow(-g.matrix * axis);
  }
  columns.col(6) = rowByRow(g.u.col(1) * g.v.col(1).transpose());
  return columns;
}

Epipolar EpipolarPairs::moved(const Epipolar& g, const Step& step) const {
  if (calibrated_) {
    const Eigen::Vector3d t =
        g.motion.translation + across(g.motion.translation) * step.segment<2>(3);
    return fromMotion({turned(step.head<3>(), g.motion.rotation), t.normalized()});
  }
  Epipolar result;
  result.u = turned(step.head<3>(), g.u);
  result.v = turned(step.segment<3>(3), g.v);
  result.s = g.s + step[6];
  result.matrix = productOf(result);
  return result;
}

std::size_t EpipolarProblem::findNear(const Epipolar& model, double limit,
                                      std::vector<std::uint8_t>& near) const {
  const Points& points = pairs_->scoring;
  const Eigen::Matrix3f f = model.matrix.cast<float>();
  return points.markNear(
      limit, [&](std::size_t first) { return squaredErrors(points, f, first); }, near);
}

float EpipolarProblem::cost(const Epipolar& model, float give_up) const {
  constexpr std::size_t kBlock = 8 * Points::kLanes;  // pairs between two checks of the sum
  const Points& points = pairs_->scoring;
  const Eigen::Matrix3f f = model.matrix.cast<float>();
  const auto limit2 = static_cast<float>(pairs_->limit * pairs_->limit);
  float cost = 0.0F;
  for (std::size_t start = 0; start < points.size; start += kBlock) {
    Points::Lanes sum = Points::Lanes::Zero();
    const std::size_t end = std::min(start + kBlock, points.size);
    std::size_t i = start;
    for (; i + Points::kLanes <= end; i += Points::kLanes) {
      sum += squaredErrors(points, f, i).min(limit2);
    }
    cost += sum.sum();
    if (i < end) {
      cost +=
          squaredErrors(points, f, i).min(limit2).head(static_cast<Eigen::Index>(end - i)).sum();
    }
    if (cost > give_up) break;
  }
  return cost;
}

/// Chirality chooses the motion, and rejects solutions whose points are not in front of the
/// cameras; without cameras, all epipolar lines must have the same orientation (Chum, Werner &
/// Matas, ICPR 2004).
void EpipolarProblem::solve(const estimation::ProsacSample& sample) {
  models_.clear();
  Eigen::Matrix<double, 3, 7> reference;
  Eigen::Matrix<double, 3, 7> target;
  for (std::size_t i = 0; i < sample.size(); ++i) {
    reference.col(static_cast<Eigen::Index>(i)) = pairs_->referenceRay(sample[i]);
    target.col(static_cast<Eigen::Index>(i)) = pairs_->targetRay(sample[i]);
  }
  if (pairs_->calibrated()) {
    solveFivePoints(reference.leftCols<5>(), target.leftCols<5>(), solutions_);
    for (const Eigen::Matrix3d& essential : solutions_) {
      for (const RelativePose& motion : motionsOf(essential)) {
        int front = 0;
        for (int k = 0; k < 5; ++k) front += inFront(motion, reference.col(k), target.col(k));
        if (front == 5) models_.push_back(pairs_->fromMotion(motion));
      }
    }
    return;
  }
  solveSevenPoints(reference, target, solutions_);
  for (const Eigen::Matrix3d& fundamental : solutions_) {
    const Epipolar model = pairs_->fromMatrix(fundamental);
    const Eigen::Vector3d epipole = model.u.col(2);
    int positive = 0;
    for (int k = 0; k < 7; ++k) {
      positive += epipole.cross(target.col(k)).dot(model.matrix * reference.col(k)) > 0.0;
    }
    if (positive == 0 || positive == 7) models_.push_back(model);
  }
}

/// Wrong pairs on an epipolar line by chance have large parallax, and so much influence; half of
/// them are behind a camera. So are far ones whose rays are parallel within the errors; these stay.
bool EpipolarProblem::isBehind(const RelativePose& motion, std::size_t i) const {
  const Eigen::Vector3d q = pairs_->referenceRay(i);
  const Eigen::Vector3d u = pairs_->targetRay(i);
  if (inFront(motion, q, u)) return false;
  const Eigen::Vector2d at = (motion.rotation * q).hnormalized();
  return (at - u.hnormalized()).norm() * pairs_->focal() > kFarLimits * pairs_->limit;
}

std::size_t EpipolarProblem::select(const Epipolar& geometry, double reach, std::size_t most) {
  findNear(geometry, reach, near_);
  std::size_t n = 0;
  selected_.resize(std::min(size(), most));
  for (std::size_t i = 0; i < size() && n < most; ++i) {
    if (near_[i] == 0) continue;
    if (pairs_->calibrated() && isBehind(geometry.motion, i)) {
      near_[i] = 0;
      continue;
    }
    selected_.set(n++, pairs_->refinement, i);
  }
  selected_.size = n;
  for (std::vector<double>* array : {&error_, &weight_, &former_weight_}) array->resize(n);
  return n;
}

/// Fills error_, weight_ and `sums` in one pass, with the current scale. The derivative of the
/// Sampson distance by F is (x' x^T - q (a x^T + x' b^T)) / n with q = C / n².
void EpipolarProblem::reweight(const Epipolar& geometry, Sums& sums) {
  const Eigen::Matrix3d& f = geometry.matrix;
  const double scale2 = scale_ * scale_;
  sums = {};
  double squares[45] = {};
  double gradient[9] = {};
  std::swap(weight_, former_weight_);
  for (std::size_t i = 0; i < selected_.size; ++i) {
    const double x[3] = {selected_.x[i], selected_.y[i], 1.0};
    const double u[3] = {selected_.u[i], selected_.v[i], 1.0};
    const Sampson<double> s(f, x[0], x[1], u[0], u[1]);
    const double inverse = 1.0 / std::sqrt(std::max(s.length2, 1e-60));
    const double e = s.value * inverse;
    const double q = e * inverse;
    const double a[3] = {q * s.a0, q * s.a1, 0.0};
    const double b[3] = {q * s.b0, q * s.b1, 0.0};
    const double w = (kFreedom + 1.0) * scale2 / (kFreedom * scale2 + e * e);
    double jacobian[9];
    for (int k = 0; k < 3; ++k) {
      for (int l = 0; l < 3; ++l) {
        jacobian[3 * k + l] = (u[k] * x[l] - a[k] * x[l] - u[k] * b[l]) * inverse;
      }
    }
    int at = 0;
    for (int k = 0; k < 9; ++k) {
      const double weighted = w * jacobian[k];
      gradient[k] += weighted * e;
      for (int l = k; l < 9; ++l) squares[at++] += weighted * jacobian[l];
    }
    sums.weight += w;
    sums.cost += w * e * e;
    sums.former_cost += former_weight_[i] * e * e;
    // d(w e)/de = w (1 - 2 e² / (f s² + e²))
    sums.derivative += w * (1.0 - 2.0 * e * e / (kFreedom * scale2 + e * e));
    error_[i] = e;
    weight_[i] = w;
  }
  int at = 0;
  for (int k = 0; k < 9; ++k) {
    sums.gradient[k] = gradient[k];
    for (int l = k; l < 9; ++l) sums.squares(k, l) = sums.squares(l, k) = squares[at++];
  }
}

/// Maximum likelihood of the scale for given errors, by expectation maximisation; fitting made the
/// errors smaller.
void EpipolarProblem::estimateScale() {
  constexpr int kRounds = 2;
  constexpr double kLeast = 1e-9;  // normalised units
  const auto freedom = static_cast<double>(pairs_->freedom());
  const auto n = static_cast<double>(selected_.size);
  const double fitted = n / std::max(n - freedom, 1.0);
  for (int round = 0; round < kRounds; ++round) {
    const double scale2 = scale_ * scale_;
    double weights = 0.0;
    double cost = 0.0;
    for (const double e : error_) {
      const double w = (kFreedom + 1.0) * scale2 / (kFreedom * scale2 + e * e);
      weights += w;
      cost += w * e * e;
    }
    scale_ = std::sqrt(fitted * cost / weights);
  }
  scale_ = std::max(scale_, kLeast);
}

bool EpipolarProblem::findStep(const Epipolar& geometry, const Sums& sums, double damping,
                               EpipolarPairs::Step& step) const {
  const EpipolarPairs::Tangent tangent = pairs_->tangent(geometry);
  Information information = tangent.transpose() * sums.squares * tangent;
  information.diagonal() *= 1.0 + damping;
  const Eigen::LDLT<Information> ldlt(information);
  if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return false;
  // The weights fall with the errors: without the factor every step would be too short.
  const double longer = std::min(sums.weight / std::max(sums.derivative, 1e-300), 2.0);
  step = ldlt.solve(tangent.transpose() * sums.gradient) * -longer;
  return step.allFinite() && step.head<3>().norm() < 1.0 && step.tail<2>().norm() < 2.0;
}

bool EpipolarProblem::refine(double widening, Epipolar& model) {
  constexpr std::size_t kEnough = 200;  // best pairs
  constexpr double kScales = 3.0;       // of the errors within the limit
  const double reach = widening * pairs_->limit;
  if (select(model, reach, kEnough) <= sampleSize()) return false;
  scale_ = reach / kScales;
  std::fill(weight_.begin(), weight_.end(), 0.0);
  Sums sums;
  reweight(model, sums);
  EpipolarPairs::Step step;
  if (!findStep(model, sums, 0.0, step)) return false;
  model = pairs_->moved(model, step);
  return true;
}

bool EpipolarProblem::minimise(Epipolar& geometry) {
  constexpr double kReach = 2.0;  // limits
  constexpr int kMaxRounds = 6;
  constexpr int kMaxSteps = 20;
  constexpr double kConverged = 1e-7;  // rad
  scale_ = pairs_->limit / kReach;
  for (int round = 0; round < kMaxRounds; ++round) {
    if (select(geometry, kReach * pairs_->limit, size()) <= sampleSize()) return false;
    if (round > 0 && near_ == used_) break;
    std::swap(near_, used_);
    std::fill(weight_.begin(), weight_.end(), 0.0);
    reweight(geometry, sums_);
    double damping = 0.0;
    for (int i = 0; i < kMaxSteps; ++i) {
      EpipolarPairs::Step step;
      if (!findStep(geometry, sums_, damping, step)) {
        if (damping > 1e3) return false;
        damping = std::max(10.0 * damping, 1e-4);
        continue;
      }
      const Epipolar candidate = pairs_->moved(geometry, step);
      const double cost = sums_.cost;
      Sums sums;
      estimateScale();
      reweight(candidate, sums);
      if (sums.former_cost <= cost) {
        geometry = candidate;
        sums_ = sums;
        damping *= 0.1;
      } else {
        reweight(geometry, sums_);
        damping = std::max(10.0 * damping, 1e-4);
      }
      if (step.cwiseAbs().maxCoeff() < kConverged) break;
    }
  }
  return true;
}

EpipolarProblem::Information EpipolarProblem::covariance(const Epipolar& geometry, double cell,
                                                         double shared) {
  selected_.findCells(cell, cell_);
  cells_.assign(homography::PointArrays<double>::kCells, Vector9::Zero());
  Eigen::Matrix<double, 9, 6> by_shared = Eigen::Matrix<double, 9, 6>::Zero();
  for (std::size_t i = 0; i < selected_.size; ++i) {
    const Eigen::Vector3d x(selected_.x[i], selected_.y[i], 1.0);
    const Eigen::Vector3d u(selected_.u[i], selected_.v[i], 1.0);
    const Sampson<double> s(geometry.matrix, x.x(), x.y(), u.x(), u.y());
    const double inverse = 1.0 / std::sqrt(std::max(s.length2, 1e-60));
    const double pull = weight_[i] * error_[i] * inverse;
    Vector9 entries;
    for (int k = 0; k < 9; ++k) entries[k] = u[k / 3] * x[k % 3];
    // A shift of the target point by 1, u or v along either axis changes the error by a / n.
    Eigen::Matrix<double, 6, 1> change;
    change << s.a0 * Eigen::Vector3d(u.z(), u.x(), u.y()),
        s.a1 * Eigen::Vector3d(u.z(), u.x(), u.y());
    by_shared += (weight_[i] * inverse * inverse * entries) * change.transpose();
    cells_[cell_[i]] += pull * entries;
  }
  // Pairs alone: as if their errors were independent and alike.
  double pull2 = 0.0;
  for (std::size_t i = 0; i < selected_.size; ++i) {
    pull2 += weight_[i] * weight_[i] * error_[i] * error_[i];
  }
  const auto p = pairs_->freedom();
  const auto freedom = static_cast<double>(p);
  const auto n = static_cast<double>(selected_.size);
  Matrix9 clustered = Matrix9::Zero();
  double clusters = 0.0;
  for (const Vector9& sum : cells_) {
    if (sum.isZero(0.0)) continue;
    clustered.noalias() += sum * sum.transpose();
    clusters += 1.0;
  }
  const EpipolarPairs::Tangent tangent = pairs_->tangent(geometry);
  const Information information =
      tangent.transpose() * sums_.squares * tangent * (sums_.derivative / sums_.weight);
  const Eigen::LDLT<Information> ldlt(information);
  if (ldlt.info() != Eigen::Success || !ldlt.isPositive() || !(sums_.derivative > 0.0)) {
    return Information::Constant(p, p, std::numeric_limits<double>::infinity());
  }
  const Information bread = ldlt.solve(Information::Identity(p, p));
  const Information independent = pull2 / sums_.weight * n / std::max(n - freedom, 1.0) *
                                  (tangent.transpose() * sums_.squares * tangent);
  const double few = clusters / std::max(clusters - freedom, 1.0);
  const Information by_cell = few * (tangent.transpose() * clustered * tangent);
  // Few cells determine how much errors are alike, but not the whole shape.
  const double alike = (independent.ldlt().solve(by_cell)).trace() / freedom;
  const Information meat =
      std::max(alike, 1.0) * independent + shared * shared * (tangent.transpose() * by_shared) *
                                               (tangent.transpose() * by_shared).transpose();
  return bread * meat * bread.transpose();
}

}  // namespace ktgp_orb::two_view
