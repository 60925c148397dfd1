#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/gms/grid.h"
#include "core/util/buckets.h"

namespace ktgp_orb::gms {

/// What the grids say about a match: bit m is set if its cell pair has support with the
/// neighbourhood rotated by m times 45 degrees. Those of the shifted grids are combined by "or".
using Votes = std::vector<std::uint16_t>;
constexpr unsigned kInBestPair = 1u << kRing;   ///< its pair is the best of its target cell
constexpr unsigned kOnGrid = kInBestPair << 1;  ///< both its keypoints are in cells

/// Motion statistics of one target grid and one reference grid: the matches sorted by their pair of
/// cells, in place of a table of all pairs, nearly all of which are empty.
class CellPairs {
 public:
  /// `reference_order`: the matches by their reference cell, `reference_cells`, the last bucket for
  /// none; `target_cells`: per match.
  void count(const Grid& target, const Grid& reference, const util::Buckets& reference_order,
             const std::vector<std::uint32_t>& reference_cells,
             const std::vector<std::uint32_t>& target_cells);

  /// Adds the verdict on the best pair of each target cell to the votes of its matches, for the
  /// first `rotations` rotations. `threshold`: T_G.
  void vote(double threshold, unsigned rotations, Votes& votes) const;

 private:
  struct Pair {
    std::uint32_t reference;  ///< its reference cell
    std::uint32_t begin;      ///< its matches are matches_[begin .. begin of the next pair)
  };

  std::uint32_t countOf(std::uint32_t pair) const {
    return pairs_[pair + 1].begin - pairs_[pair].begin;
  }
  std::uint32_t bestOf(std::uint32_t target_cell) const;
  double meanMatches(std::uint32_t target_cell, unsigned neighbours) const;
  unsigned supportedRotations(std::uint32_t target_cell, std::uint32_t best, double threshold,
                              unsigned rotations) const;

  const Grid* target_ = nullptr;
  const Grid* reference_ = nullptr;
  util::Buckets target_order_;
  std::vector<std::uint32_t> matches_;     ///< sorted by target cell, then by reference cell
  std::vector<Pair> pairs_;                ///< in the same order, and an end
  std::vector<std::uint32_t> first_pair_;  ///< of each target cell, and an end
};

}  // namespace ktgp_orb::gms
