#include "two_view/epipolar.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "util/constants.h"
#include "util/small_matrix.h"

namespace ktgp_orb::two_view {
namespace {

/// Sampson distance of a pair (reference point x, target point x'): C / n with C = x'^T F x, where
/// n is the norm of C's gradient with respect to the four coordinates. `a`, `b`: derivatives of C
/// with respect to the target and the reference point.
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
  constexpr float kTiny = 1e-30F;  // minimum of n², because n is zero at the epipoles
  const Sampson<Points::Lanes> s(f, Points::load(p.x, first), Points::load(p.y, first),
                                 Points::load(p.u, first), Points::load(p.v, first));
  return s.value * s.value / s.length2.max(kTiny);
}

std::size_t markNear(const EpipolarPairs& pairs, const Epipolar& model, double limit,
                     std::vector<std::uint8_t>& near) {
  const Eigen::Matrix3f f = model.matrix.cast<float>();
  return pairs.scoring.markNear(
      limit, [&](std::size_t first) { return squaredErrors(pairs.scoring, f, first); }, near);
}

const estimation::FitRules kRules = [] {
  estimation::FitRules rules;
  rules.most_steps = 20;
  rules.converged = 1e-6;  // rad
  rules.longest = 1.0;
  return rules;
}();

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
                         double max_error, const std::optional<Cameras>& cameras,
                         const std::vector<double>* deviations) {
  const auto by_quality = [&order](std::size_t place) { return order[place]; };
  NormalisedPairs::load(pairs.reference, pairs.target, by_quality, max_error, true);
  precision.assign(size(), 1.0);
  for (std::size_t i = 0; deviations != nullptr && i < size(); ++i) {
    precision[i] = 1.0 / (*deviations)[order[i]];
  }
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

Epipolar EpipolarPairs::moved(const Epipolar& g, const estimation::Step& step) const {
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

double EpipolarPairs::distance(const Epipolar& g, std::size_t i) const {
  const homography::PointArrays<double>& p = refinement;
  if (calibrated_) {
    const Eigen::Vector3d q = referenceRay(i);
    const Eigen::Vector3d u = targetRay(i);
    if (!inFront(g.motion, q, u)) {
      const Eigen::Vector3d at = g.motion.rotation * q;
      if (!(at.z() > 0.0)) return std::numeric_limits<double>::infinity();
      return std::sqrt(0.5) * focal_ * (at.hnormalized() - u.hnormalized()).norm();
    }
  }
  const Sampson<double> s(g.matrix, p.x[i], p.y[i], p.u[i], p.v[i]);
  return std::abs(s.value) / std::sqrt(std::max(s.length2, 1e-60));
}

float costOf(const EpipolarPairs& pairs, const Epipolar& model, float give_up) {
  // After every block of this many pairs, we check whether the cost exceeds `give_up`.
  constexpr std::size_t kBlock = 8 * Points::kLanes;
  const Points& points = pairs.scoring;
  const Eigen::Matrix3f f = model.matrix.cast<float>();
  const auto limit2 = static_cast<float>(pairs.limit * pairs.limit);
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

/// Sets models_ to the geometries that the sample allows. With cameras, all points of the sample
/// must be in front of both cameras. Without cameras, all epipolar lines must have the same
/// orientation (Chum, Werner & Matas, ICPR 2004).
void EpipolarProblem::solve(const estimation::ProsacSample& sample) {
  // Solutions of about 30 samples. With half as many, twice as many motions of points on a few
  // edges were wrong and certain.
  constexpr std::size_t kMostTried = 128;
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
        if (front < 5) continue;
        models_.push_back(pairs_->fromMotion(motion));
        if (tried_.size() < kMostTried) tried_.push_back(models_.back());
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

double apart(const RelativePose& a, const RelativePose& b) {
  const double turn = Eigen::AngleAxisd(a.rotation * b.rotation.transpose()).angle();
  const double cosine = a.translation.dot(b.translation);
  return std::max(turn, std::acos(std::clamp(cosine, -1.0, 1.0)));
}

const std::vector<Epipolar>& EpipolarProblem::rivalsOf(const Epipolar& best) {
  constexpr std::size_t kMost = 6;
  constexpr double kApart = 5.0 * util::kPi / 180.0;
  // A rival must explain at least this share of what `best` explains. It is less than all, because
  // the solution of five noisy pairs explains less than it will after a fit. Of 240 drawn sets of
  // points on a few edges, as many were wrong and certain as without this limit.
  constexpr float kLeastShare = 0.5F;
  constexpr float kAll = std::numeric_limits<float>::infinity();
  const auto none = static_cast<float>(static_cast<double>(pairs_->size()) * pairs_->limit *
                                       pairs_->limit);  // cost of a motion that explains nothing
  const float least = kLeastShare * (none - costOf(*pairs_, best, kAll));
  scored_.clear();
  rivals_.clear();
  for (std::size_t i = 0; i < tried_.size(); ++i) {
    const float cost = costOf(*pairs_, tried_[i], none - least);
    if (none - cost > least) scored_.emplace_back(cost, i);
  }
  std::sort(scored_.begin(), scored_.end());
  for (const auto& scored : scored_) {
    if (rivals_.size() == kMost) break;
    const Epipolar& model = tried_[scored.second];
    const auto is_near = [&](const Epipolar& other) {
      return apart(other.motion, model.motion) < kApart;
    };
    if (!is_near(best) && std::none_of(rivals_.begin(), rivals_.end(), is_near)) {
      rivals_.push_back(model);
    }
  }
  return rivals_;
}

std::size_t EpipolarProblem::findInliers(const Epipolar& model,
                                         std::vector<std::uint8_t>& inlier) const {
  return markNear(*pairs_, model, pairs_->limit, inlier);
}

/// With the symbols of struct Sampson, the derivative of the distance with respect to F is (x' x^T
/// - q (a x^T + x' b^T)) / n, where q = C / n².
double SampsonProblem::evaluate(std::size_t i, const Eigen::Matrix3d& f, double* by_entries,
                                Eigen::RowVector4d* by_points) const {
  const double x[3] = {points.x[i], points.y[i], 1.0};
  const double u[3] = {points.u[i], points.v[i], 1.0};
  const Sampson<double> s(f, x[0], x[1], u[0], u[1]);
  const double inverse = 1.0 / std::sqrt(std::max(s.length2, 1e-60));
  const double e = s.value * inverse;
  const double q = e * inverse;
  const double a[3] = {q * s.a0, q * s.a1, 0.0};
  const double b[3] = {q * s.b0, q * s.b1, 0.0};
  const double scaled = inverse * precision[i];
  for (int k = 0; k < 3; ++k) {
    for (int l = 0; l < 3; ++l) {
      by_entries[3 * k + l] = (u[k] * x[l] - a[k] * x[l] - u[k] * b[l]) * scaled;
    }
  }
  if (by_points != nullptr) *by_points = scaled * Eigen::RowVector4d(s.b0, s.b1, s.a0, s.a1);
  return e * precision[i];
}

/// Sums the normal equations for the entries of F in one pass, and converts them to the parameters.
void SampsonProblem::linearise(const Epipolar& g, estimation::RobustWeights& weights,
                               estimation::NormalEquations& sums) const {
  using estimation::kStudentFreedom;
  double squares[45] = {};
  double gradient[9] = {};
  double jacobian[9];
  sums = {};
  std::swap(weights.weight, weights.former);
  for (std::size_t i = 0; i < points.size; ++i) {
    const double e = evaluate(i, g.matrix, jacobian, nullptr);
    const double w = estimation::studentWeight(e * e, weights.scale2, 1.0);
    int at = 0;
    for (int k = 0; k < 9; ++k) {
      const double weighted = w * jacobian[k];
      gradient[k] += weighted * e;
      for (int l = k; l < 9; ++l) squares[at++] += weighted * jacobian[l];
    }
    const double q = w * (kStudentFreedom / (kStudentFreedom + 1.0));
    sums.weight += w;
    sums.derivative += w * (2.0 * q - 1.0);
    sums.square += w * w * e * e;
    sums.cost += w * e * e;
    sums.former_cost += weights.former[i] * e * e;
    weights.squared[i] = e * e;
    weights.weight[i] = w;
  }
  Eigen::Matrix<double, 9, 9> full;
  int at = 0;
  for (int k = 0; k < 9; ++k) {
    for (int l = k; l < 9; ++l) full(k, l) = full(l, k) = squares[at++];
  }
  const EpipolarPairs::Tangent tangent = pairs->tangent(g);
  sums.squares = tangent.transpose() * full * tangent;
  sums.gradient = tangent.transpose() * Eigen::Map<const Vector9>(gradient);
}

/// Selects the pairs with an error below `reach`, at most `most`. Leaves out a pair whose point is
/// behind a camera: it is wrong, and a wrong pair near its epipolar line has a large parallax and
/// thus much influence on the fit. Keeps a pair whose rays are parallel within their errors.
std::size_t EpipolarFit::select(const Epipolar& geometry, double reach, std::size_t most) {
  // If distance() of a pair exceeds this multiple of scale() (and `reach`), its point counts as
  // behind a camera.
  constexpr double kBehind = 3.0;
  const EpipolarPairs& pairs = *problem_.pairs;
  markNear(pairs, geometry, reach, near_);
  const std::size_t size = pairs.size();
  std::size_t n = 0;
  problem_.points.resize(std::min(size, most));
  problem_.precision.resize(problem_.points.size);
  for (std::size_t i = 0; i < size && n < most; ++i) {
    if (near_[i] == 0) continue;
    if (left_out_ >= 0 && group_[i] == left_out_) {
      near_[i] = 0;
      continue;
    }
    if (pairs.calibrated() &&
        pairs.distance(geometry, i) * pairs.precision[i] > std::max(reach, kBehind * scale())) {
      near_[i] = 0;
      continue;
    }
    problem_.precision[n] = pairs.precision[i];
    problem_.points.set(n++, pairs.refinement, i);
  }
  problem_.points.size = n;
  return n;
}

bool EpipolarFit::step(double reach, Epipolar& geometry) {
  constexpr std::size_t kEnough = 200;  // a step uses at most this many pairs, the best ones
  constexpr double kScales = 3.0;       // assumed ratio of `reach` to the scale of the errors
  fit_.weights().setScale(reach / kScales);
  const auto freedom = static_cast<std::size_t>(problem_.pairs->freedom());
  const std::size_t n = select(geometry, reach, kEnough);
  if (n <= freedom) return false;
  fit_.weights().reset(n, 1, freedom);
  return fit_.step(problem_, kRules, geometry);
}

bool EpipolarFit::minimise(Epipolar& geometry) {
  // Pairs with an error above this multiple of the limit for inliers are left out.
  constexpr double kReach = 2.0;
  constexpr int kMostRounds = 6;
  const EpipolarPairs& pairs = *problem_.pairs;
  const auto freedom = static_cast<std::size_t>(pairs.freedom());
  fit_.weights().setScale(pairs.limit / kReach);
  for (int round = 0; round < kMostRounds; ++round) {
    const std::size_t n = select(geometry, kReach * pairs.limit, pairs.size());
    if (n <= freedom) return false;
    if (round > 0 && near_ == used_) break;
    fit_.weights().reset(n, 1, freedom);
    std::swap(near_, used_);
    // The fit also ends as `undetermined` if only rounding errors prevent a better step. Then it
    // has converged, and all entries of breadOf() are finite.
    if (fit_.minimise(problem_, kRules, geometry) == estimation::FitEnd::undetermined &&
        !estimation::breadOf(fit_.sums()).allFinite()) {
      return false;
    }
  }
  return true;
}

/// Leaves out each quarter of the cells in turn and fits again (a jackknife over groups). Returns
/// the mean squared change of the motion, divided by the value that `covariance` predicts.
double EpipolarFit::instability(const Epipolar& geometry, double cell,
                                const Covariance6& covariance) {
  constexpr int kGroups = 4;
  constexpr double kLost = 25.0;  // squared change if the remaining pairs do not determine a motion
  const Eigen::Matrix<double, 6, 6> inverse = util::pseudoInverseOf(covariance);
  const util::Cells cells = problem_.pairs->refinement.findCells(2.0 * cell, cell_);
  const auto columns = static_cast<std::size_t>(cells.columns());
  group_.resize(cell_.size());
  for (std::size_t i = 0; i < cell_.size(); ++i) {
    group_[i] = static_cast<int>(cell_[i] % columns % 2 + 2 * (cell_[i] / columns % 2));
  }
  double sum = 0.0;
  for (left_out_ = 0; left_out_ < kGroups; ++left_out_) {
    Epipolar part = geometry;
    const bool found = minimise(part);
    const Eigen::Matrix<double, 6, 1> step = stepBetween(geometry.motion, part.motion);
    sum += found ? step.dot(inverse * step) : kLost;
  }
  left_out_ = -1;
  return sum * (kGroups - 1) / (kGroups * static_cast<double>(problem_.pairs->freedom()));
}

estimation::Information EpipolarFit::covariance(const Epipolar& geometry, double cell) {
  const EpipolarPairs::Tangent tangent = problem_.pairs->tangent(geometry);
  using Points = homography::PointArrays<double>;
  const Points& points = problem_.points;
  clusters_.reset(tangent.cols(),
                  std::max(Points::kUsualCells, points.findCells(cell, cell_).count()));
  Vector9 entries;
  for (std::size_t i = 0; i < points.size; ++i) {
    const double e = problem_.evaluate(i, geometry.matrix, entries.data(), nullptr);
    clusters_.add(cell_[i], fit_.weights().weight[i] * e * (tangent.transpose() * entries));
  }
  const estimation::Information independent =
      estimation::inflationOfWeights(fit_.sums(), fit_.weights()) *
      estimation::independentMeat(fit_.sums(), fit_.weights());
  return estimation::sandwich(estimation::breadOf(fit_.sums()), clusters_.inflated(independent));
}

EpipolarFit::SharedSteps EpipolarFit::sharedSteps(const Epipolar& geometry,
                                                  const SharedShifts& shared) const {
  const homography::Normalisation& from = problem_.pairs->reference;
  const homography::Normalisation& to = problem_.pairs->target;
  const EpipolarPairs::Tangent tangent = problem_.pairs->tangent(geometry);
  const homography::PointArrays<double>& points = problem_.points;
  SharedSteps pulls = SharedSteps::Zero(tangent.cols(), SharedShifts::kErrors);
  Vector9 entries;
  Eigen::RowVector4d by_points;
  for (std::size_t i = 0; i < points.size; ++i) {
    problem_.evaluate(i, geometry.matrix, entries.data(), &by_points);
    const Eigen::Vector2d x = from.applyInverse({points.x[i], points.y[i]});
    const Eigen::Vector2d u = to.applyInverse({points.u[i], points.v[i]});
    pulls += fit_.weights().weight[i] * (tangent.transpose() * entries) *
             (to.scale * by_points * shared.at(x, u));
  }
  return -estimation::breadOf(fit_.sums()) * pulls;
}

}  // namespace ktgp_orb::two_view
