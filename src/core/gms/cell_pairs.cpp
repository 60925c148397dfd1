#include "core/gms/cell_pairs.h"

#include <algorithm>
#include <cmath>

namespace ktgp_orb::gms {
namespace {

/// Bit k of the result is bit (k - m) mod 8: the ring rotated by m places.
unsigned turned(unsigned ring, unsigned m) {
  return ((ring << m) | (ring >> (kRing - m))) & 0xffu;
}

/// score >= T_G * sqrt(matches / cells), computed in double precision as in the authors' program.
bool reaches(std::uint32_t score, double threshold, std::uint32_t matches, int cells) {
  // Compares the squares, which is faster than a root, unless they are too close because of
  // rounding.
  const double left = static_cast<double>(score) * score * cells;
  const double right = threshold * threshold * matches;
  if (std::abs(left - right) > 1e-9 * right) return left > right;
  return score >= threshold * std::sqrt(static_cast<double>(matches) / cells);
}

}  // namespace

void CellPairs::count(const CellMembers& members, const Grid& target, const Grid& reference,
                      const std::vector<std::uint32_t>& reference_cells) {
  members_ = &members;
  target_ = &target;
  reference_ = &reference;
  histogram_.resize(std::max<std::size_t>(histogram_.size(), reference.cells), 0);
  const std::size_t room = members.matches().size() + kReadBeyond;
  references_.resize(room);
  steps_.resize(room);
  counts_.resize(room);
  cells_.resize(members.places() + 1);

  Cell sums;
  for (std::size_t place = 0; place < members.places(); ++place) {
    const CellMembers::Cell& position = members.cells()[place];
    const std::uint32_t end = members.cells()[place + 1].begin;
    Cell cell = sums;
    cell.target = reference.cell(position.column, position.row);
    for (std::uint32_t i = position.begin; i < end; ++i) {
      const std::uint32_t r = reference_cells[members.matches()[i]];
      if (r == kNoCell) continue;
      references_[sums.pairs] = r;  // the next one overwrites it if it is not new
      sums.pairs += histogram_[r]++ == 0 ? 1 : 0;
      ++sums.matches;
    }
    std::uint64_t best = 0;  // count << 32 | ~cell: the largest value is the best
    for (std::uint32_t i = cell.pairs; i < sums.pairs; ++i) {
      const std::uint32_t r = references_[i];
      const std::uint32_t n = histogram_[r];
      histogram_[r] = 0;
      steps_[i] = static_cast<std::int32_t>(r - cell.target);
      counts_[i] = static_cast<std::int32_t>(n);
      best = std::max(best, std::uint64_t{n} << 32 | static_cast<std::uint32_t>(~r));
    }
    cell.best_count = static_cast<std::uint32_t>(best >> 32);
    cell.best = cell.best_count > 0 ? ~static_cast<std::uint32_t>(best) : kNoCell;
    sums.best_counts += cell.best_count;
    cells_[place] = cell;
  }
  cells_[members.places()] = sums;
}

std::uint32_t CellPairs::targetIndex(std::size_t place) const {
  const CellMembers::Cell& position = members_->cells()[place];
  return target_->cell(position.column, position.row);
}

CellPairs::Neighbourhood CellPairs::neighbourhood(std::size_t place) const {
  const std::uint32_t cell = targetIndex(place);
  const auto stride = static_cast<std::uint32_t>(target_->stride);
  const auto row = [this](std::uint32_t centre) {
    return Row{members_->rank(centre - 1), members_->rank(centre + 2)};
  };
  return {row(cell - stride), row(cell), row(cell + stride)};
}

std::uint32_t CellPairs::sumAround(const Neighbourhood& around, std::uint32_t Cell::*field) const {
  std::uint32_t sum = 0;
  for (const Row& row : around) sum += cells_[row.end].*field - cells_[row.begin].*field;
  return sum;
}

bool CellPairs::maySupport(std::size_t place, double threshold) const {
  if (cells_[place].best_count == 0) return false;
  if (reference_->neighbours[cells_[place].best] < kRing) return true;
  // For every rotation, a neighbour contributes at most the count of its own best pair.
  const Neighbourhood around = neighbourhood(place);
  return reaches(sumAround(around, &Cell::best_counts), threshold,
                 sumAround(around, &Cell::matches), 1 + target_->neighbours[targetIndex(place)]);
}

std::uint32_t CellPairs::scoreUpright(const Cell& cell, const Neighbourhood& around) const {
  // The same neighbour in both grids: the same step from target cell to reference cell.
  const auto step = static_cast<std::int32_t>(cell.best - cell.target);
  std::array<PairRange, 3> ranges;
  for (std::size_t i = 0; i < around.size(); ++i) {
    ranges[i] = {cells_[around[i].begin].pairs, cells_[around[i].end].pairs};
  }
  return static_cast<std::uint32_t>(
      kernels_->sum_of_step(steps_.data(), counts_.data(), ranges, step));
}

CellPairs::Scores CellPairs::scoreRotations(const Cell& cell, const Neighbourhood& around) const {
  // Values without a direction go to the second half, which avoids a branch.
  std::array<std::uint32_t, std::size_t{2} * kRing> sums{};
  const Grid& grid = *reference_;
  for (const Row& row : around) {
    const std::uint32_t end = cells_[row.end].pairs;
    for (std::uint32_t i = cells_[row.begin].pairs; i < end; ++i) {
      const unsigned k =
          grid.direction(references_[i] - static_cast<std::uint32_t>(steps_[i]), cell.target);
      const unsigned j = grid.direction(references_[i], cell.best);
      sums[((k - j) & (kRing - 1)) | ((k | j) & kRing)] += static_cast<std::uint32_t>(counts_[i]);
    }
  }
  Scores scores{};
  for (unsigned m = 0; m < kRing; ++m) scores[m] = cell.best_count + sums[m];
  return scores;
}

unsigned CellPairs::supportedAtReferenceBorder(std::size_t place, const Scores& scores,
                                               unsigned rotations, double threshold) const {
  const std::uint32_t index = targetIndex(place);
  const unsigned target_inside = target_->inside[index];
  const unsigned reference_inside = reference_->inside[cells_[place].best];
  Scores matches{};
  for (unsigned k = 0; k < kRing; ++k) {
    const std::uint32_t neighbour = index + target_->ring[k];
    matches[k] =
        cells_[members_->rank(neighbour + 1)].matches - cells_[members_->rank(neighbour)].matches;
  }
  unsigned supported = 0;
  for (unsigned m = 0; m < rotations; ++m) {
    // Neighbours that are outside their image do not count.
    const unsigned valid = target_inside & turned(reference_inside, m);
    std::uint32_t sum = cells_[place + 1].matches - cells_[place].matches;
    int cells = 1;
    for (unsigned k = 0; k < kRing; ++k) {
      sum += (valid >> k & 1u) * matches[k];
      cells += static_cast<int>(valid >> k & 1u);
    }
    supported |= (reaches(scores[m], threshold, sum, cells) ? 1u : 0u) << m;
  }
  return supported;
}

unsigned CellPairs::supportedRotations(std::size_t place, double threshold,
                                       bool all_rotations) const {
  const Cell& cell = cells_[place];
  if (cell.best_count == 0) return 0;
  const Neighbourhood around = neighbourhood(place);
  Scores scores{};
  if (all_rotations) {
    scores = scoreRotations(cell, around);
  } else {
    scores[0] = scoreUpright(cell, around);
  }
  const unsigned rotations = all_rotations ? kRing : 1;
  if (reference_->neighbours[cell.best] < kRing)
    return supportedAtReferenceBorder(place, scores, rotations, threshold);
  // Only at the target's border: the missing neighbours have no matches.
  const int cells = 1 + target_->neighbours[targetIndex(place)];
  const std::uint32_t matches = sumAround(around, &Cell::matches);
  unsigned supported = 0;
  for (unsigned m = 0; m < rotations; ++m) {
    supported |= (reaches(scores[m], threshold, matches, cells) ? 1u : 0u) << m;
  }
  return supported;
}

}  // namespace ktgp_orb::gms
