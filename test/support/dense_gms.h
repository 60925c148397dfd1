#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/gms_filter.h"

namespace ktgp_orb::test {

/// Grid-based motion statistics as in the paper (Bian et al., CVPR 2017): for each scale, rotation
/// and shift a dense table of all cell pairs is cleared, filled and scanned. The reference for
/// GmsFilter, and its peer in the benchmark. Shares no code with it.
class DenseGms {
 public:
  explicit DenseGms(const GmsOptions& options) : options_(options) {}

  /// 1 where the match is kept, for every correspondence of any level.
  const std::vector<std::uint8_t>& mask(const Features& reference, const Features& target,
                                        const std::vector<Correspondence>& matches) {
    left_.clear();
    right_.clear();
    for (const Correspondence& c : matches) {
      left_.push_back(normalised(target, c.target_index));
      right_.push_back(normalised(reference, c.reference_index));
    }
    best_mask_.assign(matches.size(), 0);
    best_count_ = 0;
    best_rotation_ = 0;
    best_scale_ = 1.0;
    static const std::array<double, 5> scales{1.0, 0.5, 1.0 / std::sqrt(2.0), std::sqrt(2.0), 2.0};
    for (std::size_t s = 0; s < (options_.scale ? scales.size() : 1); ++s) {
      setScale(scales[s]);
      for (int rotation = 0; rotation < (options_.rotation ? 8 : 1); ++rotation) {
        const std::size_t count = run(rotation);
        if (count <= best_count_) continue;
        best_count_ = count;
        best_mask_ = mask_;
        best_rotation_ = rotation;
        best_scale_ = scales[s];
      }
    }
    return best_mask_;
  }

  std::size_t kept() const { return best_count_; }
  int rotationDegrees() const { return 45 * best_rotation_; }
  double scale() const { return best_scale_; }

 private:
  static cv::Point2f normalised(const Features& features, std::int32_t index) {
    const cv::Point2f& p = features.keypoints[static_cast<std::size_t>(index)].pt;
    return {p.x / static_cast<float>(features.image_size.width),
            p.y / static_cast<float>(features.image_size.height)};
  }

  void setScale(double scale) {
    right_columns_ = std::max(1, static_cast<int>(options_.grid_columns * scale));
    right_rows_ = std::max(1, static_cast<int>(options_.grid_rows * scale));
    right_cell_.clear();
    for (const cv::Point2f& p : right_) {
      const double x = std::floor(p.x * static_cast<float>(right_columns_));
      const double y = std::floor(p.y * static_cast<float>(right_rows_));
      right_cell_.push_back(cellAt(x, y, 0, 0, right_columns_, right_rows_));
    }
  }

  static int cellAt(double x, double y, int first_x, int first_y, int columns, int rows) {
    if (!(x >= first_x && x < columns && y >= first_y && y < rows)) return -1;
    return static_cast<int>(x) + static_cast<int>(y) * columns;
  }

  /// All four shifted grids with one rotation; fills mask_.
  std::size_t run(int rotation) {
    mask_.assign(left_.size(), 0);
    for (int shift = 0; shift < 4; ++shift) {
      countPairs(shift % 2, shift / 2);
      verifyPairs(rotation);
      for (std::size_t i = 0; i < left_.size(); ++i) {
        if (left_cell_[i] < 0 || right_cell_[i] < 0) continue;
        if (best_right_[static_cast<std::size_t>(left_cell_[i])] == right_cell_[i]) mask_[i] = 1;
      }
    }
    return static_cast<std::size_t>(std::count(mask_.begin(), mask_.end(), 1));
  }

  void countPairs(int shift_x, int shift_y) {
    const auto left_cells = static_cast<std::size_t>(options_.grid_columns * options_.grid_rows);
    const auto right_cells = static_cast<std::size_t>(right_columns_ * right_rows_);
    table_.assign(left_cells * right_cells, 0);
    left_count_.assign(left_cells, 0);
    left_cell_.resize(left_.size());
    for (std::size_t i = 0; i < left_.size(); ++i) {
      const cv::Point2f& p = left_[i];
      // The product in single precision, the half in double, as in the authors' program.
      const double x = std::floor(p.x * static_cast<float>(options_.grid_columns) + 0.5 * shift_x);
      const double y = std::floor(p.y * static_cast<float>(options_.grid_rows) + 0.5 * shift_y);
      const int left = cellAt(x, y, shift_x, shift_y, options_.grid_columns, options_.grid_rows);
      left_cell_[i] = left;
      if (left < 0 || right_cell_[i] < 0) continue;
      ++count(left, right_cell_[i]);
      ++left_count_[static_cast<std::size_t>(left)];
    }
  }

  /// best_right_: for each left cell the right cell with most matches, -1 if it has none or too
  /// little support.
  void verifyPairs(int rotation) {
    best_right_.assign(left_count_.size(), -1);
    for (int left = 0; left < static_cast<int>(left_count_.size()); ++left) {
      if (left_count_[static_cast<std::size_t>(left)] == 0) continue;
      const int* row = &count(left, 0);
      const int best =
          static_cast<int>(std::max_element(row, row + right_columns_ * right_rows_) - row);
      if (isSupported(left, best, rotation)) best_right_[static_cast<std::size_t>(left)] = best;
    }
  }

  bool isSupported(int left, int right, int rotation) {
    // Positions around the right cell of the nine left neighbours, row by row.
    static const std::array<std::array<int, 9>, 8> kPattern{{{0, 1, 2, 3, 4, 5, 6, 7, 8},
                                                             {3, 0, 1, 6, 4, 2, 7, 8, 5},
                                                             {6, 3, 0, 7, 4, 1, 8, 5, 2},
                                                             {7, 6, 3, 8, 4, 0, 5, 2, 1},
                                                             {8, 7, 6, 5, 4, 3, 2, 1, 0},
                                                             {5, 8, 7, 2, 4, 6, 1, 0, 3},
                                                             {2, 5, 8, 1, 4, 7, 0, 3, 6},
                                                             {1, 2, 5, 0, 4, 8, 3, 6, 7}}};
    int score = 0;
    double matches = 0.0;
    int pairs = 0;
    for (int k = 0; k < 9; ++k) {
      const int l = neighbour(left, k, options_.grid_columns, options_.grid_rows);
      const int j = kPattern[static_cast<std::size_t>(rotation)][static_cast<std::size_t>(k)];
      const int r = neighbour(right, j, right_columns_, right_rows_);
      if (l < 0 || r < 0) continue;
      score += count(l, r);
      matches += left_count_[static_cast<std::size_t>(l)];
      ++pairs;
    }
    return !(score < options_.threshold * std::sqrt(matches / pairs));
  }

  static int neighbour(int cell, int k, int columns, int rows) {
    const int x = cell % columns + k % 3 - 1;
    const int y = cell / columns + k / 3 - 1;
    return x < 0 || x >= columns || y < 0 || y >= rows ? -1 : x + y * columns;
  }

  int& count(int left, int right) {
    return table_[static_cast<std::size_t>(left) *
                      static_cast<std::size_t>(right_columns_ * right_rows_) +
                  static_cast<std::size_t>(right)];
  }

  GmsOptions options_;
  std::vector<cv::Point2f> left_, right_;  ///< normalised positions
  std::vector<int> left_cell_, right_cell_;
  int right_columns_ = 0, right_rows_ = 0;
  std::vector<int> table_;  ///< matches per left and right cell
  std::vector<int> left_count_, best_right_;
  std::vector<std::uint8_t> mask_, best_mask_;
  std::size_t best_count_ = 0;
  int best_rotation_ = 0;
  double best_scale_ = 1.0;
};

}  // namespace ktgp_orb::test
