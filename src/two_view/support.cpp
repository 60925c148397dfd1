#include "two_view/support.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "estimation/false_alarms.h"
#include "util/cells.h"

namespace ktgp_orb::two_view {
namespace {

/// Finds the cell of each point. `apart`: side of a cell; the cells are larger if an axis would
/// otherwise have more than 1024 cells.
void numberCells(const std::vector<Eigen::Vector2d>& points, double apart,
                 std::vector<std::uint32_t>& cell, std::vector<std::uint8_t>& taken) {
  constexpr int kMost = 1024;
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : points) box.extend(p);
  const double side = std::max(apart, box.sizes().maxCoeff() / (kMost - 1.0));
  const util::Cells cells(box.min(), box.sizes(), side, kMost);
  cell.clear();
  for (const Eigen::Vector2d& p : points) {
    cell.push_back(static_cast<std::uint32_t>(cells.at(p.x(), p.y())));
  }
  taken.resize(cells.count());
}

}  // namespace

void Support::load(const PointPairs& pairs, double apart) {
  numberCells(pairs.reference, apart, reference_cell_, reference_taken_);
  numberCells(pairs.target, apart, target_cell_, target_taken_);
}

void Support::clear() {
  std::fill(reference_taken_.begin(), reference_taken_.end(), std::uint8_t(0));
  std::fill(target_taken_.begin(), target_taken_.end(), std::uint8_t(0));
}

/// Returns true if a cell of `pair` has been marked since clear(). If not, marks both of its cells.
bool Support::isRepeated(std::uint32_t pair) {
  std::uint8_t& reference = reference_taken_[reference_cell_[pair]];
  std::uint8_t& target = target_taken_[target_cell_[pair]];
  if (reference != 0 || target != 0) return true;
  reference = target = 1;
  return false;
}

double Support::logFalseAlarms(const std::vector<double>& chance, std::size_t sample,
                               double models) {
  const auto count = static_cast<std::uint32_t>(chance.size());
  order_.clear();
  for (std::uint32_t i = 0; i < count; ++i) {
    if (chance[i] < 1.0) order_.push_back(i);
  }
  const auto agreeing = static_cast<std::ptrdiff_t>(order_.size());
  for (std::uint32_t i = 0; i < count; ++i) {
    if (chance[i] >= 1.0) order_.push_back(i);
  }
  std::sort(order_.begin(), order_.begin() + agreeing, [&](std::uint32_t a, std::uint32_t b) {
    return chance[a] != chance[b] ? chance[a] < chance[b] : a < b;
  });
  clear();
  const auto repeated = [&](std::uint32_t i) { return isRepeated(i); };
  order_.erase(std::remove_if(order_.begin(), order_.end(), repeated), order_.end());
  if (order_.size() <= sample) return 0.0;
  estimation::FalseAlarms false_alarms(sample, order_.size());
  const double log_models = std::log10(models);
  double least = 0.0;
  for (std::size_t k = sample; k < order_.size() && chance[order_[k]] < 1.0; ++k) {
    // Computes the number of false alarms if the first k + 1 pairs agree by chance, and no others;
    // p is the largest `chance` of these pairs. Skips k if so many pairs are expected to
    // agree by chance.
    const double p = chance[order_[k]];
    const double log_subsets = false_alarms.next(p);
    const auto others = static_cast<double>(order_.size() - k - 1);
    if (static_cast<double>(k + 1 - sample) <= p * static_cast<double>(order_.size() - sample)) {
      continue;
    }
    const double log_others = others * std::log1p(-p) / std::log(10.0);
    least = std::min(least, log_models + log_subsets + log_others);
  }
  return least;
}

double Support::logParallax(const std::vector<Displacement>& pairs) {
  clear();
  double sum = 0.0;
  double squares = 0.0;
  double largest = 0.0;
  double second = 0.0;
  double n = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const auto [error2, across2] = pairs[i];
    if (!(error2 > 0.0) || isRepeated(static_cast<std::uint32_t>(i))) continue;
    sum += error2 - 2.0 * std::min(across2, error2);
    squares += error2 * error2;
    second = std::max(second, std::min(largest, error2));
    largest = std::max(largest, error2);
    n += 1.0;
  }
  sum -= largest + second;  // two pairs always agree with the epipole that they determine
  if (!(sum > 0.0)) return 0.0;
  return std::min(0.0, std::log10(0.5 * n * (n - 1.0)) - sum * sum / (squares * std::log(10.0)));
}

}  // namespace ktgp_orb::two_view
