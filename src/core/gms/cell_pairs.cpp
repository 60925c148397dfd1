#include "core/gms/cell_pairs.h"

#include <algorithm>
#include <cmath>

namespace ktgp_orb::gms {
namespace {

/// Bit k of the result is bit (k - m) mod 8: the ring rotated by m places.
unsigned turned(unsigned ring, unsigned m) {
  return ((ring << m) | (ring >> (kRing - m))) & 0xffu;
}

/// score >= T_G * sqrt(matches / cells), in double precision as in the authors' program.
bool reaches(std::uint32_t score, double threshold, std::uint32_t matches, int cells) {
  // Compares the squares, which is faster than a root, unless rounding could change the result.
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
  cells_.resize(members.places());
  sums_.resize(members.places() + 1);

  Sums sums;
  for (std::uint32_t place = 0; place < members.places(); ++place) {
    const CellMembers::Cell& position = members.cells()[place];
    sums_[place] = sums;
    sums = addPairs(place, reference_cells, sums);
    const std::uint32_t cell = reference.cell(position.column, position.row);
    cells_[place] = closeCell(cell, sums_[place].pairs, sums.pairs);
    sums.best_counts += cells_[place].best_count;
  }
  sums_[members.places()] = sums;
}

/// Lists the reference cells of the matches at `place`, and counts them in the histogram. Returns
/// the sums with these matches and pairs.
inline CellPairs::Sums CellPairs::addPairs(std::uint32_t place,
                                           const std::vector<std::uint32_t>& reference_cells,
                                           Sums sums) {
  const std::uint32_t end = members_->cells()[place + 1].begin;
  for (std::uint32_t i = members_->cells()[place].begin; i < end; ++i) {
    const std::uint32_t r = reference_cells[members_->matches()[i]];
    if (r == kNoCell) continue;
    ++sums.matches;
    references_[sums.pairs] = r;  // without a branch: the next one overwrites it unless r is new
    sums.pairs += histogram_[r]++ == 0 ? 1 : 0;
  }
  return sums;
}

/// Moves the counts of a target cell's pairs, from `begin` to `end`, out of the histogram, and
/// finds the best pair.
inline CellPairs::Cell CellPairs::closeCell(std::uint32_t target_cell, std::uint32_t begin,
                                            std::uint32_t end) {
  Cell cell;
  cell.target = target_cell;
  for (std::uint32_t i = begin; i < end; ++i) {
    const std::uint32_t r = references_[i];
    const std::uint32_t n = histogram_[r];
    histogram_[r] = 0;
    steps_[i] = static_cast<std::int32_t>(r - target_cell);
    counts_[i] = static_cast<std::int32_t>(n);
    const bool better = n > cell.best_count || (n == cell.best_count && r < cell.best);
    cell.best = better ? r : cell.best;
    cell.best_count = better ? n : cell.best_count;
  }
  return cell;
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

std::uint32_t CellPairs::sumAround(const Neighbourhood& around, std::uint32_t Sums::*field) const {
  std::uint32_t sum = 0;
  for (const Row& row : around) sum += sums_[row.end].*field - sums_[row.begin].*field;
  return sum;
}

bool CellPairs::maySupport(std::size_t place, double threshold) const {
  if (cells_[place].best_count == 0) return false;
  if (reference_->neighbours[cells_[place].best] < kRing) return true;
  // For every rotation, a neighbour contributes at most the count of its own best pair.
  const Neighbourhood around = neighbourhood(place);
  return reaches(sumAround(around, &Sums::best_counts), threshold,
                 sumAround(around, &Sums::matches), 1 + target_->neighbours[targetIndex(place)]);
}

std::uint32_t CellPairs::scoreUpright(const Cell& cell, const Neighbourhood& around) const {
  // The same neighbour in both grids: the same step from target cell to reference cell.
  const auto step = static_cast<std::int32_t>(cell.best - cell.target);
  std::array<PairRange, 3> ranges;
  for (std::size_t i = 0; i < around.size(); ++i) {
    ranges[i] = {sums_[around[i].begin].pairs, sums_[around[i].end].pairs};
  }
  return static_cast<std::uint32_t>(
      kernels_->sum_of_step(steps_.data(), counts_.data(), ranges, step));
}

CellPairs::Scores CellPairs::scoreRotations(const Cell& cell, const Neighbourhood& around) const {
  // A step from neighbour k of the target cell to neighbour j of the reference cell supports the
  // rotation by k - j. The sums have a second half for pairs that are not neighbours on both sides
  // (k or j is kRing), so that the loop has no branch: that halves the time of the rotations.
  std::array<std::uint32_t, std::size_t{2} * kRing> sums{};
  const Grid& grid = *reference_;
  for (const Row& row : around) {
    const std::uint32_t end = sums_[row.end].pairs;
    for (std::uint32_t i = sums_[row.begin].pairs; i < end; ++i) {
      const std::uint32_t target_cell = references_[i] - static_cast<std::uint32_t>(steps_[i]);
      const unsigned k = grid.direction(target_cell, cell.target);
      const unsigned j = grid.direction(references_[i], cell.best);
      const unsigned unrelated = (k | j) & kRing;
      sums[(k - j) % kRing + unrelated] += static_cast<std::uint32_t>(counts_[i]);
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
    matches[k] = sums_[members_->rank(neighbour + 1)].matches -
                 sums_[members_->rank(neighbour)].matches;  // 0 if it is not occupied
  }
  unsigned supported = 0;
  for (unsigned m = 0; m < rotations; ++m) {
    // Pairs of neighbours with one outside its image do not count.
    const unsigned valid = target_inside & turned(reference_inside, m);
    std::uint32_t sum = matchesAt(place);
    int cells = 1;
    for (unsigned k = 0; k < kRing; ++k) {
      if ((valid >> k & 1u) == 0) continue;
      sum += matches[k];
      ++cells;
    }
    if (reaches(scores[m], threshold, sum, cells)) supported |= 1u << m;
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
  const std::uint32_t matches = sumAround(around, &Sums::matches);
  unsigned supported = 0;
  for (unsigned m = 0; m < rotations; ++m) {
    if (reaches(scores[m], threshold, matches, cells)) supported |= 1u << m;
  }
  return supported;
}

}  // namespace ktgp_orb::gms
