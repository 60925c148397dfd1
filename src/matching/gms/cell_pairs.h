#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "util/buckets.h"

namespace ktgp_orb::gms {

/// Number of neighbours of a cell. They are numbered clockwise from the top left neighbour, so
/// rotating the neighbourhood by m times 45 degrees shifts the numbers by m.
constexpr unsigned kRing = 8;

/// The cells of an image with a border of one cell around them, numbered row by row. Because of the
/// border, every cell of the image has all eight neighbours. We do not use CellGrid, because GMS
/// asks for the neighbours of cells, not for points near a position.
struct Grid {
  Grid(int grid_columns, int grid_rows)
      : columns(grid_columns),
        rows(grid_rows),
        stride(static_cast<std::uint32_t>(grid_columns) + 2),
        cells(stride * (static_cast<std::uint32_t>(grid_rows) + 2)),
        ring{0 - stride - 1, 0 - stride, 0 - stride + 1, 1,
             stride + 1,     stride,     stride - 1,     0 - 1u} {}

  /// The cell number that means "in no cell".
  std::uint32_t noCell() const { return cells; }

  /// Returns the number of the cell at a position. The unit of x and y is the size of a cell, and
  /// the origin is the corner of the image. Returns noCell() for NaN, for positions beyond the
  /// grid, and for positions above `first_row` or left of `first_column`.
  std::uint32_t cellAt(double x, double y, int first_column = 0, int first_row = 0) const {
    const bool inside = x >= first_column && x < columns && y >= first_row && y < rows;
    if (!inside) return noCell();
    return (static_cast<std::uint32_t>(y) + 1) * stride + static_cast<std::uint32_t>(x) + 1;
  }

  /// Bit k is set if neighbour k of the cell belongs to the image and not to the border around it.
  unsigned neighboursOf(std::uint32_t cell) const {
    const std::uint32_t column = cell % stride;
    const std::uint32_t row = cell / stride;
    unsigned inside = 0b11111111;
    if (row == 1) inside &= 0b11111000;
    if (column + 2 == stride) inside &= 0b11100011;
    if (row == static_cast<std::uint32_t>(rows)) inside &= 0b10001111;
    if (column == 1) inside &= 0b00111110;
    return inside;
  }

  int columns;
  int rows;
  std::uint32_t stride;
  std::uint32_t cells;  ///< number of cells, including the border
  /// The number of neighbour k is the number of the cell + ring[k], mod 2^32.
  std::array<std::uint32_t, kRing> ring;
};

/// The votes for each match. Bit m is set if the cell pair of the match has support with the
/// neighbourhood rotated by m times 45 degrees. Votes of the shifted grids are combined by "or".
using Votes = std::vector<std::uint16_t>;
/// This bit is set if the match is in the best cell pair of its target cell.
constexpr unsigned kInBestPair = 1u << kRing;
/// This bit is set if both keypoints of the match are in cells of the grids.
constexpr unsigned kOnGrid = kInBestPair << 1;

/// Motion statistics of one target grid and one reference grid. The matches are sorted by their
/// pair of cells, and only pairs of cells with matches are stored: a table of all pairs would be
/// nearly empty.
class CellPairs {
 public:
  /// Counts the matches of each pair of cells. `reference_order`: the matches sorted by reference
  /// cell; the last bucket is for matches whose reference keypoint is in no cell.
  /// `reference_cells`, `target_cells`: cell of each match.
  void count(const Grid& target, const Grid& reference, const util::Buckets& reference_order,
             const std::vector<std::uint32_t>& reference_cells,
             const std::vector<std::uint32_t>& target_cells);

  /// Finds the best pair of each target cell and the rotations that support it, and adds both to
  /// the votes of the matches in this pair. Only the first `rotations` rotations are tried.
  /// `threshold`: T_G, see GmsOptions::threshold.
  void vote(double threshold, unsigned rotations, Votes& votes) const;

 private:
  struct Pair {
    std::uint32_t reference;  ///< reference cell of the pair
    std::uint32_t begin;      ///< the pair's matches are matches_[begin .. begin of the next pair)
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
  /// Indices of the matches, sorted by target cell, then by reference cell.
  std::vector<std::uint32_t> matches_;
  std::vector<Pair> pairs_;  ///< pairs of cells, sorted like the matches; an end marker follows
  /// Index in pairs_ of each target cell's first pair; the last entry marks the end.
  std::vector<std::uint32_t> first_pair_;
};

}  // namespace ktgp_orb::gms
