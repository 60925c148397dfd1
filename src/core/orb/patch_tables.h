#pragma once

#include <cstdint>

#include "core/orb/kernels_common.h"
#include "core/orb/pattern.h"

namespace ktgp_orb::orb {

/// Columns of the orientation disc, rounded up to whole registers.
constexpr int kDiscColumns = 32;

/// The orientation disc for vector code: column c is at x = c - kOrientationRadius.
struct DiscTable {
  std::uint8_t rows[kOrientationRadius + 1][kDiscColumns];  ///< 255 inside, by distance of the row
  std::int16_t x[kDiscColumns];
};

constexpr DiscTable makeDiscTable() {
  DiscTable table{};
  for (int column = 0; column < kDiscColumns; ++column) {
    const int x = column - kOrientationRadius;
    table.x[column] = static_cast<std::int16_t>(x);
    for (int y = 0; y <= kOrientationRadius; ++y) {
      const bool inside = x >= -kDiscHalfWidth[y] && x <= kDiscHalfWidth[y];
      table.rows[y][column] = inside ? 255 : 0;
    }
  }
  return table;
}

constexpr DiscTable kDiscTable = makeDiscTable();

/// The sampling pattern in single precision: the first point of every pair, then the second ones.
struct PatternTable {
  alignas(64) float x[2 * kPatternPairs];
  alignas(64) float y[2 * kPatternPairs];
};

constexpr PatternTable makePatternTable() {
  PatternTable table{};
  for (int i = 0; i < kPatternPairs; ++i) {
    table.x[i] = kOrbPattern.first_x[i];
    table.y[i] = kOrbPattern.first_y[i];
    table.x[kPatternPairs + i] = kOrbPattern.second_x[i];
    table.y[kPatternPairs + i] = kOrbPattern.second_y[i];
  }
  return table;
}

constexpr PatternTable kPatternTable = makePatternTable();

}  // namespace ktgp_orb::orb
