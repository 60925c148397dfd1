#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "util/buckets.h"

namespace ktgp_orb::util {

/// Sorts points into square cells, so that the points near a position are found fast. A point
/// outside the image is put into the nearest cell; a NaN coordinate counts as 0. The next build()
/// uses the same memory.
class CellGrid {
 public:
  /// Sorts `count` points into cells. `point(i)`: returns the position of point i, px. `side`: side
  /// of a cell, px, above 0; if there would be too many cells, a longer side is used.
  template <typename Point>
  void build(std::size_t count, const Point& point, const cv::Size& image, double side) {
    // Maximum number of cells along the longer side of the image. With more cells, visiting empty
    // cells would cost more time than the smaller cells save.
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

  /// Indices of the points, cell by cell: the cells row by row, and ascending indices within a
  /// cell.
  const std::vector<std::int32_t>& order() const { return points_.order(); }

  /// Visits the points in the cells that intersect the square around (x, y) with half side
  /// `radius`. In each row of cells, these cells are neighbours, so their points follow each other
  /// in order(). Calls visit(begin, end) once for each row, with the range of these points in
  /// order().
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
    // NaN makes this comparison false, so it gets cell 0.
    return cell >= 1.0 ? static_cast<int>(std::min(cell, count - 1.0)) : 0;
  }

  double per_side_ = 1.0;
  int columns_ = 1;
  int rows_ = 1;
  Buckets points_;  // indices of the points, sorted by cell
};

}  // namespace ktgp_orb::util
