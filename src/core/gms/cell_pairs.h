#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/gms/grid.h"
#include "core/gms/kernels.h"

namespace ktgp_orb::gms {

/// Motion statistics of one target grid and one reference grid: the number of matches of each pair
/// of cells, the best pair of each target cell, and the rotations that support this pair.
class CellPairs {
 public:
  /// Counts the cell pairs. `reference_cells`: per match, its cell in `reference` or kNoCell.
  /// The first three arguments must stay valid until the next call.
  void count(const CellMembers& members, const Grid& target, const Grid& reference,
             const std::vector<std::uint32_t>& reference_cells);

  /// The reference cell with most matches of the target cell at `place`, the first one for equal
  /// numbers; kNoCell if there is none.
  std::uint32_t best(std::size_t place) const { return cells_[place].best; }

  /// False only if no rotation can support the best pair of the cell at `place`.
  bool maySupport(std::size_t place, double threshold) const;

  /// Bit m is set if the best pair of the cell at `place` is supported with the neighbourhood
  /// rotated by m times 45 degrees. Without `all_rotations` only bit 0 is computed.
  unsigned supportedRotations(std::size_t place, double threshold, bool all_rotations) const;

 private:
  /// An occupied target cell.
  struct Cell {
    std::uint32_t target = kNoCell;  ///< number in the layout of the reference grid
    std::uint32_t best = kNoCell;    ///< reference cell of its best pair
    std::uint32_t best_count = 0;    ///< matches of that pair
  };
  /// Sums over all cells before a place: the difference of two is the sum over the cells in
  /// between.
  struct Sums {
    std::uint32_t pairs = 0;  ///< also the index of the first pair of the cell
    std::uint32_t matches = 0;
    std::uint32_t best_counts = 0;
  };
  /// Three cells in a row, as a range of places.
  struct Row {
    std::uint32_t begin;
    std::uint32_t end;
  };
  using Neighbourhood = std::array<Row, 3>;
  using Scores = std::array<std::uint32_t, kRing>;

  std::uint32_t targetIndex(std::size_t place) const;
  Neighbourhood neighbourhood(std::size_t place) const;
  std::uint32_t sumAround(const Neighbourhood& around, std::uint32_t Sums::*field) const;
  Sums addPairs(std::uint32_t place, const std::vector<std::uint32_t>& reference_cells, Sums sums);
  Cell closeCell(std::uint32_t target_cell, std::uint32_t begin, std::uint32_t end);
  std::uint32_t matchesAt(std::size_t place) const {
    return sums_[place + 1].matches - sums_[place].matches;
  }
  std::uint32_t scoreUpright(const Cell& cell, const Neighbourhood& around) const;
  Scores scoreRotations(const Cell& cell, const Neighbourhood& around) const;
  unsigned supportedAtReferenceBorder(std::size_t place, const Scores& scores, unsigned rotations,
                                      double threshold) const;

  const GmsKernels* kernels_ = &bestGmsKernels();
  const CellMembers* members_ = nullptr;
  const Grid* target_ = nullptr;
  const Grid* reference_ = nullptr;
  std::vector<Cell> cells_;  ///< by place
  std::vector<Sums> sums_;   ///< by place, and a last one with the totals

  // The pairs, sorted by the place of their target cell.
  std::vector<std::uint32_t> references_;  ///< reference cell
  std::vector<std::int32_t> steps_;        ///< reference cell minus Cell::target
  std::vector<std::int32_t> counts_;       ///< matches of the pair

  std::vector<std::uint32_t> histogram_;  ///< per reference cell; zero between two target cells
};

}  // namespace ktgp_orb::gms
