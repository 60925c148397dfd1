#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "util/buckets.h"

namespace ktgp_orb::util {

/// Sorts points into square cells, so that the points near a position are found fast. Points
/// outside the image belong to the nearest cell; NaN counts as 0. Keeps its buffers.
class CellGrid {
 public:
  /// Sorts `count` points. `point(i)`: position of point i, px. `side`: side of a cell, px, > 0; it
  /// is increased if there would be too many cells.
  template <typename Point>
  void build(std::size_t count, const Point& point, const cv::Size& image, double side) {
    // Maximum number of cells along a side; more cells would cost more time than they save.
    constexpr double kMostCells = 1024.0;
    per_side_ = 1.0 / std::max(side, std::max(image.width, image.height) / kMostCells);
    columns_ = static_cast<int>(image.width * per_side_) + 1;
    rows_ = static_cast<int>(image.height * per_side_) + 1;
    points_.sort(count, static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_),
                 [&](std::size_t i) {
                   const cv::Point2f p = point(i);
                   return row(p.y) * columns_ + column(p.x);
                 });
  }

  /// Indices of the points, cell by cell. The cells are ordered row by row, and the indices within
  /// a cell are ascending.
  const std::vector<std::int32_t>& order() const { return points_.order(); }

  /// The cells that intersect the square of half side `radius` around (x, y) form one run of
  /// order() per row of cells. Calls visit(begin, end) for each of these runs.
  template <typename Visit>
  void visitRuns(double x, double y, double radius, Visit visit) const {
    const int left = column(x - radius);
    const int right = column(x + radius);
    const int last = row(y + radius);
    for (int r = row(y - radius); r <= last; ++r) {
      const int first = r * columns_ + left;
      const int last_cell = r * columns_ + right;
      visit(points_.begin(static_cast<std::size_t>(first)),
            points_.end(static_cast<std::size_t>(last_cell)));
    }
  }

  /// Calls visit(index) for every point of the cells that visitRuns() visits.
  template <typename Visit>
  void visitNear(double x, double y, double radius, Visit visit) const {
    visitRuns(x, y, radius, [&](std::uint32_t begin, std::uint32_t end) {
      for (std::uint32_t i = begin; i < end; ++i) visit(order()[i]);
    });
  }

 private:
  int column(double x) const { return clamped(x, columns_); }
  int row(double y) const { return clamped(y, rows_); }
  int clamped(double x, int count) const {
    const double cell = x * per_side_;
    // The comparison is written so that NaN gets cell 0.
    return cell >= 1.0 ? static_cast<int>(std::min(cell, count - 1.0)) : 0;
  }

  double per_side_ = 1.0;
  int columns_ = 1;
  int rows_ = 1;
  Buckets points_;  // indices of the points, sorted by cell
};

}  // namespace ktgp_orb::util
