#include "core/gms/grid.h"

#include <algorithm>

namespace ktgp_orb::gms {
namespace {

// Clockwise from the top left.
constexpr std::array<int, kRing> kStepX{-1, 0, 1, 1, 1, 0, -1, -1};
constexpr std::array<int, kRing> kStepY{-1, -1, -1, 0, 1, 1, 1, 0};

}  // namespace

Grid::Grid(int grid_columns, int grid_rows)
    : columns(grid_columns),
      rows(grid_rows),
      stride(grid_columns + 2),
      cells(static_cast<std::uint32_t>((grid_columns + 2) * (grid_rows + 2))),
      ring{},
      inside(cells, 0),
      neighbours(cells, 0),
      direction_by_difference(2 * static_cast<std::size_t>(cells), kRing) {
  for (unsigned k = 0; k < kRing; ++k) {
    ring[k] = static_cast<std::uint32_t>(kStepY[k] * stride + kStepX[k]);
    direction_by_difference[ring[k] + cells] = static_cast<std::uint8_t>(k);
  }
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      for (unsigned k = 0; k < kRing; ++k) {
        const int x = column + kStepX[k];
        const int y = row + kStepY[k];
        if (x >= 0 && x < columns && y >= 0 && y < rows) {
          inside[cell(column, row)] |= static_cast<std::uint8_t>(1u << k);
          ++neighbours[cell(column, row)];
        }
      }
    }
  }
}

void CellMembers::assign(const Grid& grid, bool shift_x, bool shift_y,
                         const std::vector<HalfCell>& positions) {
  // A counting sort.
  countMatches(grid, shift_x, shift_y, positions);
  listOccupied(grid);
  sortMatches();
}

void CellMembers::countMatches(const Grid& grid, bool shift_x, bool shift_y,
                               const std::vector<HalfCell>& positions) {
  const int add_x = shift_x ? 1 : 0;
  const int add_y = shift_y ? 1 : 0;
  cell_of_match_.resize(positions.size());
  count_.assign(grid.cells, 0);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const int column = (positions[i].column + add_x) / 2;
    const int row = (positions[i].row + add_y) / 2;
    const bool in_grid = (column >= add_x) & (column < grid.columns) &  // no branches
                         (row >= add_y) & (row < grid.rows);
    const std::uint32_t cell = in_grid ? grid.cell(column, row) : kNoCell;
    cell_of_match_[i] = cell;
    ++count_[cell];
  }
}

void CellMembers::listOccupied(const Grid& grid) {
  count_[kNoCell] = 0;
  cells_.resize(grid.cells + 1);
  rank_.resize(grid.cells + 1);
  next_.resize(grid.cells);
  std::uint32_t occupied = 0;
  std::uint32_t begin = 0;
  std::uint32_t cell = 0;
  for (int row = -1; row <= grid.rows; ++row) {
    for (int column = -1; column <= grid.columns; ++column, ++cell) {
      rank_[cell] = occupied;
      next_[cell] = begin;
      // Without a branch: the next cell overwrites the entry of an empty one.
      cells_[occupied] = {static_cast<std::uint16_t>(column), static_cast<std::uint16_t>(row),
                          begin};
      occupied += count_[cell] > 0 ? 1 : 0;
      begin += count_[cell];
    }
  }
  rank_[grid.cells] = occupied;
  cells_[occupied] = {0, 0, begin};
  cells_.resize(occupied + 1);
}

void CellMembers::sortMatches() {
  matches_.resize(cells_.back().begin);
  place_of_match_.resize(cell_of_match_.size());
  for (std::size_t i = 0; i < cell_of_match_.size(); ++i) {
    const std::uint32_t cell = cell_of_match_[i];
    if (cell == kNoCell) {
      place_of_match_[i] = static_cast<std::uint32_t>(places());
      continue;
    }
    matches_[next_[cell]++] = static_cast<std::uint32_t>(i);
    place_of_match_[i] = rank_[cell];
  }
}

}  // namespace ktgp_orb::gms
