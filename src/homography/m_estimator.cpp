#include "homography/m_estimator.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace ktgp_orb::homography {
namespace {

using Matrix8 = MEstimator::Matrix8;
using Vector8 = MEstimator::Vector8;
using Points = PointArrays<double>;
using Lanes = Eigen::Array<double, 2, 1>;
using Map = Eigen::Map<Lanes>;

constexpr double kFreedom = 4.0;  // of Student's t; 4 did best on keypoints of real images
constexpr double kEntries = 8.0;  // estimated entries of H

Lanes load(const std::vector<double>& array, std::size_t first) {
  return Eigen::Map<const Lanes>(array.data() + first);
}

double sum(const Lanes& lanes) {
  return lanes[0] + lanes[1];
}

/// Two reference points mapped by H, and their errors in the target.
struct Projection {
  Lanes x, y, z;  // reference point over the third coordinate w, and 1/w
  Lanes u, v;     // projected
  Lanes du, dv;   // projected - target

  Projection(const Points& points, const Eigen::Matrix3d& h, std::size_t first) {
    x = load(points.x, first);
    y = load(points.y, first);
    z = 1.0 / (h(2, 0) * x + h(2, 1) * y + h(2, 2));
    u = (h(0, 0) * x + h(0, 1) * y + h(0, 2)) * z;
    v = (h(1, 0) * x + h(1, 1) * y + h(1, 2)) * z;
    x *= z;
    y *= z;
    du = u - load(points.u, first);
    dv = v - load(points.v, first);
  }
};

/// The sums of J^T w J and J^T w e. J's rows for one pair are [x y z 0 0 0 -u x -u y] and
/// [0 0 0 x y z -v x -v y], so that J^T w J has 19 different entries, not 36.
class NormalEquations {
 public:
  NormalEquations() {
    for (Lanes* sums : {plain_, times_u_, times_v_}) std::fill_n(sums, 5, Lanes::Zero());
    std::fill_n(squared_, 3, Lanes::Zero());
    std::fill_n(gradient_, 8, Lanes::Zero());
  }

  void add(const Projection& p, const Lanes& weight) {
    const Lanes x = weight * p.x;
    const Lanes y = weight * p.y;
    const Lanes z = weight * p.z;
    const Lanes products[5] = {x * p.x, x * p.y, x * p.z, y * p.y, y * p.z};
    for (int i = 0; i < 5; ++i) {
      plain_[i] += products[i];
      times_u_[i] += p.u * products[i];
      times_v_[i] += p.v * products[i];
    }
    zz_ += z * p.z;
    const Lanes q = p.u * p.u + p.v * p.v;
    squared_[0] += q * products[0];
    squared_[1] += q * products[1];
    squared_[2] += q * products[3];
    gradient_[0] += x * p.du;
    gradient_[1] += y * p.du;
    gradient_[2] += z * p.du;
    gradient_[3] += x * p.dv;
    gradient_[4] += y * p.dv;
    gradient_[5] += z * p.dv;
    const Lanes along = p.u * p.du + p.v * p.dv;
    gradient_[6] -= x * along;
    gradient_[7] -= y * along;
  }

  void store(Matrix8& jtj, Vector8& jtr) const {
    const auto [xx, xy, xz, yy, yz] = totals(plain_);
    Eigen::Matrix3d plain;
    plain << xx, xy, xz,  //
        xy, yy, yz,       //
        xz, yz, sum(zz_);
    const Eigen::Matrix<double, 3, 2> u = border(times_u_);
    const Eigen::Matrix<double, 3, 2> v = border(times_v_);
    Eigen::Matrix2d corner;
    corner << sum(squared_[0]), sum(squared_[1]), sum(squared_[1]), sum(squared_[2]);
    jtj << plain, Eigen::Matrix3d::Zero(), -u,  //
        Eigen::Matrix3d::Zero(), plain, -v,     //
        -u.transpose(), -v.transpose(), corner;
    for (int i = 0; i < 8; ++i) jtr[i] = sum(gradient_[i]);
  }

 private:
  static std::array<double, 5> totals(const Lanes (&sums)[5]) {
    return {sum(sums[0]), sum(sums[1]), sum(sums[2]), sum(sums[3]), sum(sums[4])};
  }

  /// [x y z]^T [x y], each product times u or v: the products of the last two parameters with the
  /// others.
  static Eigen::Matrix<double, 3, 2> border(const Lanes (&sums)[5]) {
    const auto [xx, xy, xz, yy, yz] = totals(sums);
    Eigen::Matrix<double, 3, 2> matrix;
    matrix << xx, xy,  //
        xy, yy,        //
        xz, yz;
    return matrix;
  }

  Lanes plain_[5];            // weighted products xx xy xz yy yz
  Lanes times_u_[5];          // the same times u
  Lanes times_v_[5];          // the same times v
  Lanes zz_ = Lanes::Zero();  // weighted zz
  Lanes squared_[3];          // (uu + vv) times xx xy yy
  Lanes gradient_[8];
};

/// The sum of J^T w J over the first `count` pairs. `weights(i)`: w of the pairs i and i + 1.
template <typename Weights>
Matrix8 sumOfSquares(const Points& points, const Eigen::Matrix3d& homography, std::size_t count,
                     const Weights& weights) {
  NormalEquations normal;
  for (std::size_t i = 0; i < count; i += 2) {
    normal.add(Projection(points, homography, i), weights(i));
  }
  Matrix8 jtj;
  Vector8 unused;
  normal.store(jtj, unused);
  return jtj;
}

Eigen::Matrix3d plus(const Eigen::Matrix3d& h, const Vector8& step) {
  Eigen::Matrix3d sum = h;
  for (int i = 0; i < 8; ++i) sum(i / 3, i % 3) += step[i];
  return sum;
}

}  // namespace

std::size_t MEstimator::select(const Points& points, const std::vector<std::uint8_t>& mask,
                               std::size_t max_pairs) {
  std::size_t n = 0;
  selected_.resize(std::min(points.size, max_pairs));
  for (std::size_t i = 0; i < points.size && n < max_pairs; ++i) {
    if (mask[i] != 0) selected_.set(n++, points, i);
  }
  selected_.size = n;
  // An odd last pair is processed with a padding pair of weight zero. An old value there could lie
  // on the horizon of the next H, and zero times infinity is NaN.
  if (n < selected_.paddedSize()) {
    selected_.set(n, Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero());
  }
  for (std::vector<double>* array : {&squared_, &weight_, &former_weight_}) {
    array->resize(selected_.paddedSize());
  }
  cell_weight_.assign(selected_.paddedSize(), 1.0);
  by_cell_ = false;
  equal_pairs_ = static_cast<double>(n);
  return n;
}

void MEstimator::weighByCell(double cell) {
  constexpr double kFewest = 64.0;  // equal pairs, eight for each entry
  const std::size_t n = selected_.size;
  if (n == 0) return;
  selected_.findCells(cell, cell_);
  in_cell_.assign(Points::kCells, 0);
  std::size_t cells = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (in_cell_[cell_[i]]++ == 0) ++cells;
  }
  const double mean = static_cast<double>(cells) / static_cast<double>(n);
  double squares = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    cell_weight_[i] = 1.0 / (mean * static_cast<double>(in_cell_[cell_[i]]));
    squares += cell_weight_[i] * cell_weight_[i];
  }
  const double equal_pairs = static_cast<double>(n) * static_cast<double>(n) / squares;
  by_cell_ = equal_pairs >= kFewest;
  if (by_cell_) {
    equal_pairs_ = equal_pairs;
  } else {
    std::fill_n(cell_weight_.begin(), n, 1.0);
  }
}

/// Fills squared_, weight_ and `sums` in one pass, with the current scale.
void MEstimator::reweight(const Eigen::Matrix3d& homography, Sums& sums) {
  NormalEquations normal;
  Lanes weights = Lanes::Zero();
  Lanes derivatives = Lanes::Zero();
  Lanes squares = Lanes::Zero();
  Lanes costs = Lanes::Zero();
  Lanes former_costs = Lanes::Zero();
  std::swap(weight_, former_weight_);
  for (std::size_t i = 0; i < selected_.size; i += 2) {
    const Projection p(selected_, homography, i);
    Lanes squared = p.du * p.du + p.dv * p.dv;
    const Lanes student = (kFreedom + 2.0) * scale2_ / (kFreedom * scale2_ + squared);
    Lanes weight = student * load(cell_weight_, i);
    if (i + 1 == selected_.size) squared[1] = weight[1] = 0.0;  // padding
    normal.add(p, weight);
    const Lanes weight2 = weight * student;
    weights += weight;
    derivatives += weight2;
    squares += weight2 * squared;
    costs += weight * squared;
    former_costs += load(former_weight_, i) * squared;
    Map(squared_.data() + i) = squared;
    Map(weight_.data() + i) = weight;
  }
  normal.store(sums.jtj, sums.jtr);
  sums.weight = sum(weights);
  sums.derivative = sum(derivatives) * kFreedom / (kFreedom + 2.0);
  sums.square = sum(squares);
  sums.cost = sum(costs);
  sums.former_cost = sum(former_costs);
}

/// Maximum likelihood of the scale for given errors, by expectation maximisation. Dividing by the
/// sum of the weights converges faster (Kent, Tyler & Vardi 1994). Fitting H to the same errors
/// made them smaller; for few pairs, much smaller.
void MEstimator::estimateScale(double min_scale) {
  constexpr int kRounds = 2;
  const double fitted = 2.0 * equal_pairs_ / freedom();
  for (int round = 0; round < kRounds; ++round) {
    Lanes weights = Lanes::Zero();
    Lanes cost = Lanes::Zero();
    for (std::size_t i = 0; i < selected_.size; i += 2) {
      const Lanes squared = load(squared_, i);
      Lanes weight = (kFreedom + 2.0) * scale2_ / (kFreedom * scale2_ + squared);
      weight *= load(cell_weight_, i);
      if (i + 1 == selected_.size) weight[1] = 0.0;  // padding
      weights += weight;
      cost += weight * squared;
    }
    scale2_ = std::max(fitted * sum(cost) / (2.0 * sum(weights)), min_scale * min_scale);
  }
}

namespace {

/// The step d with c (JtwJ + damping diag(JtwJ)) d = -Jtwe; false where it is not determined. The
/// factor c, derivative over weight, turns J^T w J into the second derivative of the likelihood.
/// Without it every step would be a fifth too short, since the weights fall with the errors.
template <typename Sums>
bool findStep(const Sums& sums, double damping, Vector8& step) {
  Matrix8 damped = sums.jtj;
  damped.diagonal() *= 1.0 + damping;
  const Eigen::LDLT<Matrix8> ldlt(damped);
  if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return false;
  step = ldlt.solve(sums.jtr) * (-sums.weight / sums.derivative);
  return step.allFinite();
}

}  // namespace

bool MEstimator::step(double scale, Eigen::Matrix3d& homography) {
  homography /= homography(2, 2);
  scale2_ = scale * scale;
  reweight(homography, sums_);
  Vector8 step;
  if (!findStep(sums_, 0.0, step)) return false;
  homography = plus(homography, step);
  return true;
}

bool MEstimator::minimise(double min_scale, double& scale, Eigen::Matrix3d& homography) {
  constexpr int kMaxSteps = 30;
  constexpr double kConverged = 1e-5;  // for entries of H of the order of 1
  homography /= homography(2, 2);
  scale2_ = scale * scale;
  reweight(homography, sums_);
  double damping = 0.0;
  for (int i = 0; i < kMaxSteps; ++i) {
    Vector8 step;
    if (!findStep(sums_, damping, step)) return false;
    const Eigen::Matrix3d candidate = plus(homography, step);
    const double cost = sums_.cost;
    Sums sums;
    estimateScale(min_scale);
    reweight(candidate, sums);
    if (sums.former_cost <= cost) {
      homography = candidate;
      sums_ = sums;
      damping *= 0.1;
    } else {
      reweight(homography, sums_);
      damping = std::max(10.0 * damping, 1e-4);
    }
    if (step.cwiseAbs().maxCoeff() < kConverged) break;
  }
  scale = std::sqrt(scale2_);
  variance_factor_ = varianceFactor();
  if (by_cell_) {
    by_squares_ = sumOfSquares(selected_, homography, selected_.size, [this](std::size_t i) {
      return Lanes(load(weight_, i) * load(cell_weight_, i));
    });
  }
  return true;
}

double MEstimator::freedom() const {
  return std::max(2.0 * equal_pairs_ - kEntries, 1.0);
}

/// Huber, Robust Statistics (1981), section 7.6: the covariance is the mean of w² e² over the
/// square of the mean of d(w e)/de, times (J^T J)^-1, here approximated by the mean weight times
/// (J^T w J)^-1. Eight of the 2n errors were used up by the eight entries. For finite samples the
/// covariance is K² times as large, K = 1 + 8/(2n) var(d(w e)/de) / mean(d(w e)/de)²: pairs that
/// pull the fit get more weight. This is the factor of (J^T w J)^-1.
double MEstimator::varianceFactor() const {
  const double n = static_cast<double>(selected_.size);
  const double square = sums_.square / freedom() * (equal_pairs_ / n);
  const double derivative = sums_.derivative / n;
  const double mean2 = derivative * derivative;
  // Along e the derivative of w e is w (2q - 1), across it w, with q = w f / (f + 2).
  double squares = 0.0;
  for (std::size_t i = 0; i < selected_.size; ++i) {
    const double student = weight_[i] / cell_weight_[i];
    const double q = student * (kFreedom / (kFreedom + 2.0));
    squares += weight_[i] * student * (2.0 * q * (q - 1.0) + 1.0);
  }
  const double variance = squares / n - mean2;
  const double k = 1.0 + kEntries / (2.0 * equal_pairs_) * variance / mean2;
  return k * k * square / mean2 * (sums_.weight / n);
}

namespace {

Matrix8 inverse(const Matrix8& information) {
  constexpr double kSingular = 1e-14;
  const Eigen::LDLT<Matrix8> ldlt(information);
  const Vector8 pivots = ldlt.vectorD();
  if (ldlt.info() != Eigen::Success || !(pivots.minCoeff() > kSingular * pivots.maxCoeff())) {
    return Matrix8::Constant(std::numeric_limits<double>::infinity());
  }
  return ldlt.solve(Matrix8::Identity());
}

}  // namespace

/// With cell weights (White 1980): A^-1 (J^T c w J) A^-1 with A = J^T w J.
Matrix8 MEstimator::covariance() const {
  const Matrix8 inverted = inverse(sums_.jtj);
  if (!by_cell_) return variance_factor_ * inverted;
  return variance_factor_ * inverted * by_squares_ * inverted;
}

Matrix8 MEstimator::covarianceWithout(const Eigen::Matrix3d& homography, std::size_t count,
                                      std::size_t fold, std::size_t folds) const {
  const auto weights = [&](std::size_t i) {
    Lanes weight = load(weight_, i);
    if (i % folds == fold) weight[0] = 0.0;
    if ((i + 1) % folds == fold || i + 1 == count) weight[1] = 0.0;
    return weight;
  };
  return variance_factor_ * inverse(sumOfSquares(selected_, homography, count, weights));
}

}  // namespace ktgp_orb::homography
