#include "matching/gms/cell_pairs.h"

#include <cmath>

namespace ktgp_orb::gms {
namespace {

/// Rotates the ring by m places: bit k of the result is bit (k - m) mod 8 of `ring`.
unsigned turned(unsigned ring, unsigned m) {
  return ((ring << m) | (ring >> (kRing - m))) & 0xffu;
}

}  // namespace

void CellPairs::count(const Grid& target, const Grid& reference,
                      const util::Buckets& reference_order,
                      const std::vector<std::uint32_t>& reference_cells,
                      const std::vector<std::uint32_t>& target_cells) {
  target_ = &target;
  reference_ = &reference;
  // The matches are already sorted by reference cell. Sorting them by target cell keeps this order
  // within each target cell.
  const std::uint32_t on_grid = reference_order.begin(reference.noCell());
  target_order_.sort(on_grid, target.cells + 1,
                     [&](std::size_t i) { return target_cells[reference_order.order()[i]]; });
  matches_.resize(on_grid);
  first_pair_.resize(target.cells + 1);
  pairs_.clear();
  for (std::uint32_t cell = 0; cell < target.cells; ++cell) {
    first_pair_[cell] = static_cast<std::uint32_t>(pairs_.size());
    const std::uint32_t begin = target_order_.begin(cell);
    for (std::uint32_t i = begin; i < target_order_.end(cell); ++i) {
      matches_[i] = static_cast<std::uint32_t>(reference_order.order()[target_order_.order()[i]]);
      const std::uint32_t r = reference_cells[matches_[i]];
      if (i == begin || r != pairs_.back().reference) pairs_.push_back({r, i});
    }
  }
  first_pair_[target.cells] = static_cast<std::uint32_t>(pairs_.size());
  pairs_.push_back({reference.noCell(), target_order_.begin(target.noCell())});
}

/// Among the cell pairs of this target cell, returns the index of the pair with the most matches.
/// If several pairs have this number of matches, returns the first of them.
std::uint32_t CellPairs::bestOf(std::uint32_t target_cell) const {
  std::uint32_t best = first_pair_[target_cell];
  for (std::uint32_t pair = best + 1; pair < first_pair_[target_cell + 1]; ++pair) {
    if (countOf(pair) > countOf(best)) best = pair;
  }
  return best;
}

unsigned CellPairs::supportedRotations(std::uint32_t target_cell, std::uint32_t best,
                                       double threshold, unsigned rotations) const {
  std::array<std::uint32_t, kRing> scores;
  scores.fill(countOf(best));
  for (unsigned k = 0; k < kRing; ++k) {
    // If the rotation is m, neighbour k of the target cell corresponds to neighbour k - m of the
    // reference cell.
    std::array<std::uint32_t, kRing> corresponding;
    for (unsigned m = 0; m < kRing; ++m) {
      corresponding[m] = pairs_[best].reference + reference_->ring[(k - m) % kRing];
    }
    const std::uint32_t neighbour = target_cell + target_->ring[k];
    for (std::uint32_t i = first_pair_[neighbour]; i < first_pair_[neighbour + 1]; ++i) {
      // Count the matches for all rotations, even if only one is wanted, because the compiler turns
      // the eight fixed lanes into vector code.
      const std::uint32_t r = pairs_[i].reference;
      const std::uint32_t count = countOf(i);
      for (unsigned m = 0; m < kRing; ++m) scores[m] += r == corresponding[m] ? count : 0;
    }
  }

  const unsigned target_inside = target_->neighboursOf(target_cell);
  const unsigned reference_inside = reference_->neighboursOf(pairs_[best].reference);
  unsigned supported = 0;
  unsigned last_inside = 0;
  double required = 0.0;
  for (unsigned m = 0; m < rotations; ++m) {
    // A neighbour does not count if it is outside the image in the target or in the reference.
    const unsigned inside = target_inside & turned(reference_inside, m);
    if (m == 0 || inside != last_inside) {
      required = threshold * std::sqrt(meanMatches(target_cell, inside));
      last_inside = inside;
    }
    if (scores[m] >= required) supported |= 1u << m;
  }
  return supported;
}

/// Returns the mean number of matches per cell, over the target cell and those neighbours whose bit
/// in `neighbours` is set.
double CellPairs::meanMatches(std::uint32_t target_cell, unsigned neighbours) const {
  std::uint32_t matches = target_order_.end(target_cell) - target_order_.begin(target_cell);
  int cells = 1;
  for (unsigned k = 0; k < kRing; ++k) {
    if ((neighbours >> k & 1u) == 0) continue;
    const std::uint32_t neighbour = target_cell + target_->ring[k];
    matches += target_order_.end(neighbour) - target_order_.begin(neighbour);
    ++cells;
  }
  return static_cast<double>(matches) / cells;
}

void CellPairs::vote(double threshold, unsigned rotations, Votes& votes) const {
  for (std::uint32_t cell = 0; cell < target_->cells; ++cell) {
    if (first_pair_[cell] == first_pair_[cell + 1]) continue;
    const std::uint32_t best = bestOf(cell);
    const unsigned bits = kInBestPair | supportedRotations(cell, best, threshold, rotations);
    for (std::uint32_t i = pairs_[best].begin; i < pairs_[best + 1].begin; ++i) {
      votes[matches_[i]] |= static_cast<std::uint16_t>(bits);
    }
  }
}

}  // namespace ktgp_orb::gms
