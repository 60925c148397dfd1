#include "homography/smooth_field.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "estimation/sandwich.h"
#include "util/cells.h"

namespace ktgp_orb::homography {
namespace {

using Matrix8 = Eigen::Matrix<double, 8, 8>;

/// Returns the product J1' J2 of two Jacobians (' is the transpose). `slopes`: slope1 slope2', the
/// product of their different entries (see Slope). A Jacobian has the rows [x y z 0 0 0 -ux -uy]
/// and [0 0 0 x y z -vx -vy].
Matrix8 expanded(const Matrix8& slopes) {
  Matrix8 m = Matrix8::Zero();
  m.topLeftCorner<3, 3>() = m.block<3, 3>(3, 3) = slopes.topLeftCorner<3, 3>();
  m.block<3, 2>(0, 6) = -slopes.block<3, 2>(0, 3);
  m.block<3, 2>(3, 6) = -slopes.block<3, 2>(0, 5);
  m.block<2, 3>(6, 0) = -slopes.block<2, 3>(3, 0);
  m.block<2, 3>(6, 3) = -slopes.block<2, 3>(5, 0);
  m.bottomRightCorner<2, 2>() = slopes.block<2, 2>(3, 3) + slopes.block<2, 2>(5, 5);
  return m;
}

double traceOfProduct(const Matrix8& a, const Matrix8& b) {
  return a.cwiseProduct(b.transpose()).sum();
}

}  // namespace

FieldFit SmoothField::fit(const PointArrays<double>& pairs, const std::vector<double>& weights,
                          double curvature, const Eigen::Matrix3d& homography,
                          const FieldScales& scales) {
  // Correlation length l of the field, as a share of the image diagonal; doc/method.md describes
  // the field, and doc/measurements/covariance.md compares the covariance with measured errors.
  constexpr double kLength = 0.6;
  // With fewer pairs, the fit of H's eight entries removes nearly all errors. Then nothing is left
  // from which the field could be estimated.
  constexpr std::size_t kFewest = 12;
  FieldFit result;
  choosePairs(pairs, weights, homography);
  if (pairs_.empty() || !(scales.image_diagonal > 0.0)) return result;
  limitErrors();
  const double cell_side = scales.image_diagonal / kCellsAlongDiagonal;
  sortIntoCells(cell_side);
  step_ = std::exp(-1.0 / (kCellsAlongDiagonal * kLength));
  smooth();
  PairSums of_pairs = sumPairs();
  sumNear(scales.nearby, of_pairs);
  const double chosen = static_cast<double>(pairs_.size());
  const double each_of_all =
      static_cast<double>(pairs.size) / chosen;  // number of pairs that a chosen pair represents
  result.shared_patches = 1.0 + 2.0 * each_of_all * of_pairs.near_overlap / chosen;

  const Matrix8 inverse = estimation::inverseOf(curvature * expanded(of_pairs.first));
  if (!inverse.allFinite()) return result;
  const CellSums of_cells = sumCells();
  const double length = std::min(scales.rounding_length, kLength * scales.image_diagonal);
  result.of_rounding = estimation::sandwich(inverse, expanded(spreadOfRounding(length, cell_side)));
  if (pairs_.size() < kFewest) return result;
  const Fitted fitted{inverse, estimation::sandwich(inverse, expanded(of_cells.spread)),
                      estimation::sandwich(inverse, expanded(of_pairs.second))};
  const Moment single = singleMoment(of_pairs, of_cells, fitted);
  solve(single, nearMoment(of_pairs, of_cells, fitted, single), scales.significance, result);
  setCovariances(of_pairs, fitted, single, result);
  return result;
}

/// Moment of the squared errors of single pairs: sum of w² |r|² (w: weight, r: residual of a pair).
/// The residuals are r = M e with M = I - J A^-1 J'W; the class comment defines J, A and W. If the
/// errors e have the covariance K, the expectation of the moment is
///
///   tr(W M K M' W) = tr(W K W) - 2 tr(A^-1 J'W³ K J) + tr(A^-1 J'W K W J A^-1 J'W² J),
///
/// with K = exp(-d/l) for the field and K = I for the noise.
SmoothField::Moment SmoothField::singleMoment(const PairSums& of_pairs, const CellSums& of_cells,
                                              const Fitted& fitted) {
  const double weights2 = of_pairs.weights2;
  const Matrix8 second = expanded(of_pairs.second);
  Moment single{of_pairs.squared_error, 2.0 * weights2, 2.0 * weights2};
  single.of_field += traceOfProduct(fitted.by_field, second) -
                     2.0 * traceOfProduct(fitted.inverse, expanded(of_cells.single));
  single.of_noise += traceOfProduct(fitted.by_noise, second) -
                     2.0 * traceOfProduct(fitted.inverse, expanded(of_pairs.third));
  return single;
}

/// Moment of the products of the errors of near pairs: sum of w w' r·r' over all combinations of
/// two pairs in one cell or in adjacent cells, with weights w, w' and errors r, r'. We leave out
/// the products of a pair with itself (moment `single`) and the combinations that share noise. The
/// expectation has the form given in singleMoment(); in it, two pairs that share noise are treated
/// as one point.
SmoothField::Moment SmoothField::nearMoment(const PairSums& of_pairs, const CellSums& of_cells,
                                            const Fitted& fitted, const Moment& single) {
  const double weights2 = of_pairs.weights2;
  const Matrix8 around = expanded(of_cells.fitted);
  Moment near{of_cells.product, of_cells.expected, 2.0 * weights2};
  near.of_field += traceOfProduct(fitted.by_field, around) -
                   2.0 * traceOfProduct(fitted.inverse, expanded(of_cells.near));
  near.of_noise += traceOfProduct(fitted.by_noise, around) -
                   2.0 * traceOfProduct(fitted.inverse, expanded(of_cells.near_noise));
  const double left_out = 1.0 + 2.0 * of_pairs.near_weight / weights2;
  near.measured -= single.measured + 2.0 * of_pairs.near_product;
  near.of_field -= left_out * single.of_field;
  near.of_noise -= left_out * single.of_noise - 2.0 * (left_out - 1.0) * weights2;
  near.deviation = 2.0 * std::sqrt(std::max(of_cells.pairs - left_out * weights2, 0.0));
  return near;
}

void SmoothField::setCovariances(const PairSums& of_pairs, const Fitted& fitted,
                                 const Moment& single, FieldFit& result) {
  // Variance of the error that all pairs have in common, as a fraction of the variance of the
  // noise; see FieldFit::common_covariance.
  constexpr double kCommon = 0.02;
  // A field that is correlated over most of the image has only about f = kFreedom independent
  // values, so the estimate of its variance is uncertain. Therefore the covariance is multiplied by
  // f / (f - 2), as for Student's t distribution with f degrees of freedom.
  constexpr double kFreedom = 6.0;
  result.noise_variance = result.noise_share * single.measured / single.of_noise;
  const Matrix8 common = expanded(of_pairs.slope * of_pairs.slope.transpose());
  result.common_covariance =
      kCommon * result.noise_variance * estimation::sandwich(fitted.inverse, common);
  result.covariance = kFreedom / (kFreedom - 2.0) * result.variance * fitted.by_field;
}

/// Sets the variance of the field (tau²) and the share of the noise from the two moments. We divide
/// the moment of near pairs by the moment of single pairs. The ratio lies between its values for
/// pure noise and for a pure field, and its position between them is the field's share of the
/// squared errors. If noise alone could give the measured ratio, we assume that there is no field.
void SmoothField::solve(const Moment& single, const Moment& near, double significance,
                        FieldFit& result) {
  // Minimum difference between the expected ratios for field and noise (`contrast`) by which we
  // divide. If the pairs cover only a few cells, the fit of H absorbs nearly the whole field, and
  // the two ratios are so close that a small error of the measured ratio would look like a field.
  constexpr double kLeastContrast = 1.0;
  const double of_noise = near.of_noise / single.of_noise;
  const double contrast = near.of_field / single.of_field - of_noise;
  const double excess = near.measured / single.measured - of_noise;
  if (!(excess > significance * near.deviation / single.of_noise)) return;
  const double share = std::clamp(excess / std::max(contrast, kLeastContrast), 0.0, 1.0);
  const double variance = share * single.measured / single.of_field;
  if (!(variance > 0.0) || !std::isfinite(variance)) return;
  result.variance = variance;
  result.noise_share = 1.0 - share;
}

SmoothField::PairSums SmoothField::sumPairs() const {
  PairSums sums;
  for (const Pair& p : pairs_) {
    const Slope weighted = p.weight * p.slope;
    const Matrix8 product = weighted * p.slope.transpose();
    sums.slope += weighted;
    const double weight2 = p.weight * p.weight;
    sums.first += product;
    sums.second += p.weight * product;
    sums.third += weight2 * product;
    sums.weights2 += weight2;
    sums.squared_error += weight2 * p.error.squaredNorm();
  }
  return sums;
}

SmoothField::CellSums SmoothField::sumCells() const {
  CellSums sums;
  const double kernel[3] = {1.0, step_, step_ * step_};
  for (std::size_t row = 0; row < rows_; ++row) {
    for (std::size_t column = 0; column < columns_; ++column) {
      const Cell& cell = cells_[row * columns_ + column];
      if (cell.weight == 0.0) continue;
      Slope around = Slope::Zero();  // sum of the slopes of the cell and the eight adjacent cells
      for (std::size_t y = row - std::min<std::size_t>(row, 1); y < std::min(row + 2, rows_); ++y) {
        for (std::size_t x = column - std::min<std::size_t>(column, 1);
             x < std::min(column + 2, columns_); ++x) {
          const Cell& other = cells_[y * columns_ + x];
          const int steps = (y == row ? 0 : 1) + (x == column ? 0 : 1);
          around += other.slope;
          sums.product += cell.error.dot(other.error);
          sums.pairs += cell.weight * other.weight;
          sums.expected += 2.0 * cell.weight * other.weight * kernel[steps];
        }
      }
      sums.spread += cell.slope * cell.smoothed.transpose();
      sums.single += cell.slope2 * cell.smoothed.transpose();
      sums.near += cell.weight * around * cell.smoothed.transpose();
      sums.near_noise += around * cell.slope2.transpose();
      sums.fitted += around * cell.slope.transpose();
    }
  }
  return sums;
}

/// Returns J'W K W J (see SmoothField) for a field with variance 1 and correlation length `length`.
SmoothField::Matrix8 SmoothField::spreadOfRounding(double length, double cell_side) {
  step_ = std::exp(-cell_side / length);
  smooth();
  Matrix8 spread = Matrix8::Zero();
  for (const Cell& cell : cells_) spread += cell.slope * cell.smoothed.transpose();
  // The sums above use exp(-d/l) = 1 for two pairs within one cell. To correct this, we multiply
  // them by the mean of exp(-d/l) over two points of a cell.
  const double share = length / cell_side;
  const double along = 2.0 * share * (1.0 - share * (1.0 - step_));
  return along * along * spread;
}

void SmoothField::choosePairs(const PointArrays<double>& pairs, const std::vector<double>& weights,
                              const Eigen::Matrix3d& homography) {
  constexpr std::size_t kMost = 300;
  const std::size_t count = std::min(pairs.size, kMost);
  pairs_.reserve(kMost);  // allocates once, for any number of pairs
  squared_.reserve(kMost);
  by_x_.reserve(kMost);
  pairs_.resize(count);
  double sum = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t from = i * pairs.size / count;
    Pair& pair = pairs_[i];
    pair.point = {pairs.x[from], pairs.y[from]};
    const Eigen::Vector3d p = homography * pair.point.homogeneous();
    const Eigen::Vector2d place = p.head<2>() / p.z();
    pair.error = place - Eigen::Vector2d(pairs.u[from], pairs.v[from]);
    const double x = pair.point.x() / p.z();
    const double y = pair.point.y() / p.z();
    pair.slope << x, y, 1.0 / p.z(), place.x() * x, place.x() * y, place.y() * x, place.y() * y,
        0.0;
    pair.weight = weights[from];
    sum += pair.weight;
  }
  for (Pair& pair : pairs_) pair.weight *= static_cast<double>(count) / sum;
}

/// A few wrong pairs side by side would look like a field. So errors are limited to five standard
/// deviations, which are estimated from the median.
void SmoothField::limitErrors() {
  constexpr double kDeviations = 5.0;
  // Median of |r|² divided by the variance of a coordinate of r, if both coordinates of the error r
  // are normally distributed.
  constexpr double kMedian = 1.386;
  squared_.clear();
  for (const Pair& pair : pairs_) squared_.push_back(pair.error.squaredNorm());
  const auto middle = squared_.begin() + static_cast<std::ptrdiff_t>(squared_.size() / 2);
  std::nth_element(squared_.begin(), middle, squared_.end());
  const double most2 = kDeviations * kDeviations * *middle / kMedian;
  for (Pair& pair : pairs_) {
    const double square = pair.error.squaredNorm();
    if (square > most2) pair.error *= std::sqrt(most2 / square);
  }
}

void SmoothField::sortIntoCells(double cell_side) {
  Eigen::Vector2d low = pairs_.front().point;
  Eigen::Vector2d high = low;
  for (const Pair& pair : pairs_) {
    low = low.cwiseMin(pair.point);
    high = high.cwiseMax(pair.point);
  }
  using Points = PointArrays<double>;
  const util::Cells cells(low, high - low, cell_side, Points::kMostCells);
  columns_ = static_cast<std::size_t>(cells.columns());
  rows_ = cells.count() / columns_;
  cells_.reserve(Points::kUsualCells);
  cells_.assign(columns_ * rows_, Cell());
  for (Pair& pair : pairs_) {
    pair.cell = cells.at(pair.point.x(), pair.point.y());
    Cell& cell = cells_[pair.cell];
    const Slope weighted = pair.weight * pair.slope;
    cell.weight += pair.weight;
    cell.error += pair.weight * pair.error;
    cell.slope += weighted;
    cell.slope2 += pair.weight * weighted;
  }
}

/// For each cell, sums the slopes of all cells with the weights exp(-d/l), where d is the
/// city-block distance of the two cells. The sums are computed first along the rows and then along
/// the columns, each time with a forward and a backward pass.
void SmoothField::smooth() {
  const auto along = [this](std::size_t first, std::size_t stride, std::size_t count) {
    const auto value = [&](std::size_t i) -> Slope& { return cells_[first + i * stride].smoothed; };
    for (std::size_t i = 1; i < count; ++i) value(i) += step_ * value(i - 1);
    Slope after = Slope::Zero();  // weighted sum over the later cells
    for (std::size_t i = count; i-- > 0;) {
      const Slope own = i > 0 ? Slope(value(i) - step_ * value(i - 1)) : value(0);
      value(i) += step_ * after;
      after = own + step_ * after;
    }
  };
  for (Cell& cell : cells_) cell.smoothed = cell.slope;
  for (std::size_t row = 0; row < rows_; ++row) along(row * columns_, 1, columns_);
  for (std::size_t column = 0; column < columns_; ++column) along(column, columns_, rows_);
}

/// Adds the sums over all combinations of two pairs that share noise.
void SmoothField::sumNear(double side, PairSums& sums) {
  by_x_.clear();
  for (std::size_t i = 0; i < pairs_.size(); ++i) by_x_.emplace_back(pairs_[i].point.x(), i);
  std::sort(by_x_.begin(), by_x_.end());
  for (auto i = by_x_.begin(); i != by_x_.end(); ++i) {
    const Pair& a = pairs_[i->second];
    for (auto j = i + 1; j != by_x_.end() && j->first - i->first < side; ++j) {
      const Pair& b = pairs_[j->second];
      const double right = (j->first - i->first) / side;
      const double down = std::abs(b.point.y() - a.point.y()) / side;
      if (down >= 1.0) continue;
      sums.near_overlap += (1.0 - right) * (1.0 - down);
      sums.near_weight += a.weight * b.weight;
      sums.near_product += a.weight * b.weight * a.error.dot(b.error);
    }
  }
}

}  // namespace ktgp_orb::homography
