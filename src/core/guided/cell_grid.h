#pragma once

#include <algorithm>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb {

/// Keypoints sorted into square cells, so that those near a place are found without looking at all.
/// Keeps its buffers.
class CellGrid {
 public:
  /// `side`: of a cell, px, > 0. Keypoints outside the image belong to the nearest cell.
  void build(const std::vector<cv::KeyPoint>& keypoints, const cv::Size& image, double side);

  /// Calls visit(index) for every keypoint of the cells that the square of half side `radius`
  /// around (x, y) meets, each cell's in ascending order.
  template <typename Visit>
  void visitNear(double x, double y, double radius, Visit visit) const {
    const int left = column(x - radius);
    const int right = column(x + radius);
    for (int r = row(y - radius); r <= row(y + radius); ++r) {
      const auto first = static_cast<std::size_t>(r * columns_ + left);
      const auto end = static_cast<std::size_t>(r * columns_ + right) + 1;
      for (std::uint32_t i = start_[first]; i < start_[end]; ++i) visit(order_[i]);
    }
  }

 private:
  int column(double x) const { return clamped(x, columns_); }
  int row(double y) const { return clamped(y, rows_); }
  int clamped(double x, int count) const {
    return static_cast<int>(std::clamp(x * per_side_, 0.0, count - 1.0));
  }

  double per_side_ = 1.0;
  int columns_ = 1;
  int rows_ = 1;
  std::vector<std::uint32_t> start_;  // of each cell in order_, and its end
  std::vector<std::int32_t> order_;   // keypoints, cell by cell
  std::vector<std::uint32_t> cell_;   // of each keypoint
};

}  // namespace ktgp_orb
