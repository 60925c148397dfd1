#include "homography/reprojection_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "estimation/sandwich.h"

namespace ktgp_orb::homography {
namespace {

using estimation::NormalEquations;
using estimation::RobustWeights;
using Matrix8 = ReprojectionFit::Matrix8;
using Vector8 = Eigen::Matrix<double, 8, 1>;
using Points = PointArrays<double>;
using Lanes = Eigen::Array<double, RobustWeights::kLanes, 1>;
using Map = Eigen::Map<Lanes>;

constexpr std::size_t kEntries = 8;  // number of estimated entries of H

Lanes load(const std::vector<double>& array, std::size_t first) {
  return Eigen::Map<const Lanes>(array.data() + first);
}

double sum(const Lanes& lanes) {
  return lanes[0] + lanes[1];
}

/// Two reference points mapped by H, one in each lane, and their errors in the target.
struct Projection {
  Lanes x, y, z;  // x, y: reference point / w (w: third coordinate of the mapped point); z: 1 / w
  Lanes u, v;     // projected point
  Lanes du, dv;   // error: projected point - target point

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

/// The sums of J^T w J and J^T w e over the pairs (J: Jacobian, w: weight, e: error of a pair).
/// With the fields of Projection, the rows of J for one pair are [x y z 0 0 0 -u x -u y] and
/// [0 0 0 x y z -v x -v y], so that J^T w J has only 19 different entries, not 36.
class ReprojectionSums {
 public:
  ReprojectionSums() {
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

  /// The block of J^T w J for the last two parameters and three of the others: [x y z]^T [x y],
  /// with each product times u or v.
  static Eigen::Matrix<double, 3, 2> border(const Lanes (&sums)[5]) {
    const auto [xx, xy, xz, yy, yz] = totals(sums);
    Eigen::Matrix<double, 3, 2> matrix;
    matrix << xx, xy,  //
        xy, yy,        //
        xz, yz;
    return matrix;
  }

  Lanes plain_[5];            // sums of the weighted products xx xy xz yy yz
  Lanes times_u_[5];          // sums of the weighted products times u
  Lanes times_v_[5];          // sums of the weighted products times v
  Lanes zz_ = Lanes::Zero();  // weighted zz
  Lanes squared_[3];          // weighted sums of (uu + vv) times xx xy yy
  Lanes gradient_[8];
};

/// Returns the sum of J^T w J over the first `count` pairs. `weights(i)`: weights w of the pairs i
/// and i + 1.
template <typename Weights>
Matrix8 sumOfSquares(const Points& points, const Eigen::Matrix3d& homography, std::size_t count,
                     const Weights& weights) {
  ReprojectionSums normal;
  for (std::size_t i = 0; i < count; i += 2) {
    normal.add(Projection(points, homography, i), weights(i));
  }
  Matrix8 jtj;
  Vector8 unused;
  normal.store(jtj, unused);
  return jtj;
}

/// The fit of H has converged when no entry changes by more than 1e-5; the entries are of the order
/// of 1. The length of a step is not limited, because even from the best PROSAC samples, the first
/// steps may be long.
estimation::FitRules rules() {
  estimation::FitRules rules;
  rules.converged = 1e-5;
  rules.lengthening = std::numeric_limits<double>::infinity();
  return rules;
}

}  // namespace

Eigen::Matrix3d ReprojectionFit::Problem::moved(const Eigen::Matrix3d& homography,
                                                const estimation::Step& step) {
  Eigen::Matrix3d sum = homography;
  for (int i = 0; i < 8; ++i) sum(i / 3, i % 3) += step[i];
  return sum;
}

void ReprojectionFit::Problem::linearise(const Eigen::Matrix3d& homography, RobustWeights& weights,
                                         NormalEquations& sums) const {
  ReprojectionSums normal;
  Lanes all = Lanes::Zero();
  Lanes derivatives = Lanes::Zero();
  Lanes squares = Lanes::Zero();
  Lanes costs = Lanes::Zero();
  Lanes former_costs = Lanes::Zero();
  std::swap(weights.weight, weights.former);
  for (std::size_t i = 0; i < pairs.size; i += RobustWeights::kLanes) {
    const Projection p(pairs, homography, i);
    const Lanes squared = p.du * p.du + p.dv * p.dv;
    const Lanes student = estimation::studentWeight(squared, weights.scale2, 2.0);
    const Lanes weight = student * load(weights.factor, i);
    normal.add(p, weight);
    const Lanes weight2 = weight * student;
    all += weight;
    derivatives += weight2;
    squares += weight2 * squared;
    costs += weight * squared;
    former_costs += load(weights.former, i) * squared;
    Map(weights.squared.data() + i) = squared;
    Map(weights.weight.data() + i) = weight;
  }
  Matrix8 jtj;
  Vector8 jtr;
  normal.store(jtj, jtr);
  sums.squares = jtj;
  sums.gradient = jtr;
  sums.weight = sum(all);
  // For sums.derivative, we need the derivative of t e with respect to e, averaged over the
  // direction of e and the direction perpendicular to it. This average is t² f / (f + 2), where e
  // is the error of a pair, t its Student weight (`student`) and f = kStudentFreedom.
  constexpr double kShare = estimation::kStudentFreedom / (estimation::kStudentFreedom + 2.0);
  sums.derivative = sum(derivatives) * kShare;
  sums.square = sum(squares);
  sums.cost = sum(costs);
  sums.former_cost = sum(former_costs);
}

std::size_t ReprojectionFit::select(const Points& points, const std::vector<std::uint8_t>& mask,
                                    std::size_t max_pairs) {
  Points& selected = problem_.pairs;
  std::size_t n = 0;
  selected.resize(std::min(points.size, max_pairs));
  for (std::size_t i = 0; i < points.size && n < max_pairs; ++i) {
    if (mask[i] != 0) selected.set(n++, points, i);
  }
  selected.size = n;
  // If the number of pairs is odd, the last pair is processed together with a padding pair of
  // weight zero. We clear the padding, because it may contain an old point that lies on the horizon
  // of H, and zero times infinity is NaN.
  if (n < selected.paddedSize()) selected.set(n, Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero());
  fit_.weights().reset(n, 2, kEntries);
  by_cell_ = false;
  return n;
}

void ReprojectionFit::weighByCell(double cell) {
  // The weights are used only if the result is not noisier than a fit to this many equally weighted
  // pairs (eight pairs for each estimated entry of H).
  constexpr double kFewest = 64.0;
  const std::size_t n = size();
  if (n == 0) return;
  in_cell_.assign(std::max(Points::kUsualCells, problem_.pairs.findCells(cell, cell_).count()), 0);
  std::size_t cells = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (in_cell_[cell_[i]]++ == 0) ++cells;
  }
  const double mean = static_cast<double>(cells) / static_cast<double>(n);
  double squares = 0.0;
  factor_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    factor_[i] = 1.0 / (mean * static_cast<double>(in_cell_[cell_[i]]));
    squares += factor_[i] * factor_[i];
  }
  const double equal_pairs = static_cast<double>(n) * static_cast<double>(n) / squares;
  by_cell_ = equal_pairs >= kFewest;
  if (by_cell_) fit_.weights().setFactors(factor_, equal_pairs);
}

bool ReprojectionFit::step(double scale, Eigen::Matrix3d& homography) {
  homography /= homography(2, 2);
  fit_.weights().setScale(scale);
  return fit_.step(problem_, rules(), homography);
}

bool ReprojectionFit::minimise(double min_scale, double& scale, Eigen::Matrix3d& homography) {
  homography /= homography(2, 2);
  RobustWeights& weights = fit_.weights();
  weights.setScale(scale);
  estimation::FitRules fit_rules = rules();
  fit_rules.least_scale = min_scale;
  if (fit_.minimise(problem_, fit_rules, homography) == estimation::FitEnd::undetermined)
    return false;
  scale = weights.scale();
  const double longer = 1.0 / curvature();
  variance_factor_ = estimation::inflationOfWeights(fit_.sums(), weights) *
                     estimation::meanSquare(fit_.sums(), weights) * longer * longer;
  if (by_cell_) {
    by_squares_ = sumOfSquares(problem_.pairs, homography, size(), [&](std::size_t i) {
      return Lanes(load(weights.weight, i) * load(weights.factor, i));
    });
  }
  return true;
}

/// If the weights w contain the factors c of the cells, the covariance is not A^-1 with
/// A = J^T w J, but A^-1 (J^T c w J) A^-1 (White 1980).
Matrix8 ReprojectionFit::covariance() const {
  const Matrix8 inverted = estimation::inverseOf(fit_.sums().squares);
  if (!by_cell_) return variance_factor_ * inverted;
  return variance_factor_ * estimation::sandwich(inverted, by_squares_);
}

Matrix8 ReprojectionFit::covarianceWithout(const Eigen::Matrix3d& homography, std::size_t count,
                                           std::size_t fold, std::size_t folds) const {
  const auto weight_of = [&](std::size_t i) {
    Lanes weight = load(weights(), i);
    if (i % folds == fold) weight[0] = 0.0;
    if ((i + 1) % folds == fold || i + 1 == count) weight[1] = 0.0;
    return weight;
  };
  return variance_factor_ *
         estimation::inverseOf(sumOfSquares(problem_.pairs, homography, count, weight_of));
}

}  // namespace ktgp_orb::homography
