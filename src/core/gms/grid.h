#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace ktgp_orb::gms {

/// Neighbours of a cell, clockwise from the top left one. So rotating the neighbourhood by m times
/// 45 degrees shifts this ring by m.
constexpr unsigned kRing = 8;

/// The index of "in no cell".
constexpr std::uint32_t kNoCell = 0;

/// A grid with a frame of one cell around it, stored row by row. Because of the frame every cell
/// has all eight neighbours in memory, index 0 is free for kNoCell, and the difference of two
/// indices determines whether the cells are neighbours, and in which direction.
struct Grid {
  Grid(int columns, int rows);

  /// Cell at (column, row), both from 0.
  std::uint32_t cell(int column, int row) const {
    return static_cast<std::uint32_t>((row + 1) * stride + column + 1);
  }

  /// Place of `other` in the ring around `centre`; kRing if it is not a neighbour.
  unsigned direction(std::uint32_t other, std::uint32_t centre) const {
    return direction_by_difference[other - centre + cells];
  }

  int columns;
  int rows;
  int stride;
  std::uint32_t cells;                    ///< including the frame
  std::array<std::uint32_t, kRing> ring;  ///< index of each neighbour minus the cell's, mod 2^32
  std::vector<std::uint8_t> inside;       ///< per cell, bit k: neighbour k is not in the frame
  std::vector<std::uint8_t> neighbours;   ///< per cell, their number, 0..8
  std::vector<std::uint8_t> direction_by_difference;
};

/// A position in half cells of the unshifted target grid, from 0.
struct HalfCell {
  std::uint16_t column;
  std::uint16_t row;
};

/// Matches sorted by the cell of their target keypoint, in a grid that may be shifted by half a
/// cell in x and y. Each occupied cell has a place: its number among the occupied cells, row by
/// row. Only the sort visits empty cells.
class CellMembers {
 public:
  struct Cell {
    std::uint16_t column;
    std::uint16_t row;
    std::uint32_t begin;  ///< its matches are matches()[begin .. begin of the next place)
  };

  /// `positions`: per match, inside the unshifted grid. A keypoint that is off the shifted grid, or
  /// in its first column or row (half outside the image), is in no cell.
  void assign(const Grid& grid, bool shift_x, bool shift_y, const std::vector<HalfCell>& positions);

  /// Number of occupied cells.
  std::size_t places() const { return cells_.size() - 1; }
  /// The occupied cells, by place; a last entry ends the last range.
  const std::vector<Cell>& cells() const { return cells_; }
  /// The matches that are in a cell, sorted by place.
  const std::vector<std::uint32_t>& matches() const { return matches_; }
  /// Place of each match; places() if it is in no cell.
  const std::vector<std::uint32_t>& placeOfMatch() const { return place_of_match_; }
  /// Number of occupied cells before this cell of the grid or its frame, or before its end.
  std::uint32_t rank(std::uint32_t cell) const { return rank_[cell]; }

 private:
  /// Finds the cell of every match, and counts the matches of every cell.
  void countMatches(const Grid& grid, bool shift_x, bool shift_y,
                    const std::vector<HalfCell>& positions);
  /// Converts the counts to the occupied cells, their ranks and the begins of their matches.
  void listOccupied(const Grid& grid);
  /// Sorts the matches that are in a cell, by cell.
  void sortMatches();

  std::vector<Cell> cells_;
  std::vector<std::uint32_t> matches_;
  std::vector<std::uint32_t> place_of_match_;
  std::vector<std::uint32_t> rank_;
  std::vector<std::uint32_t> cell_of_match_;
  std::vector<std::uint32_t> count_;  ///< per cell: its matches
  std::vector<std::uint32_t>
      next_;  ///< per cell: index in matches_ of the next one to be sorted in
};

}  // namespace ktgp_orb::gms
