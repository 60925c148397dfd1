#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "util/buckets.h"
#include "util/cells.h"

namespace ktgp_orb::util {

/// Sorts points into the Cells of an image, so that the points near a position are found fast. The
/// next build() uses the same memory.
class CellGrid {
 public:
  /// Sorts `count` points into cells. `point(i)`: returns the position of point i, px. `side`: side
  /// of a cell, px, above 0; if there would be too many cells, a longer side is used.
  template <typename Point>
  void build(std::size_t count, const Point& point, const cv::Size& image, double side) {
    // Maximum number of cells along the longer side of the image. With more cells, visiting empty
    // cells would cost more time than the smaller cells save.
    constexpr double kMostCells = 1024.0;
    cells_ = Cells(image, std::max(side, std::max(image.width, image.height) / kMostCells));
    points_.sort(count, cells_.count(), [&](std::size_t i) {
      const cv::Point2f p = point(i);
      return cells_.at(p.x, p.y);
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
    const int left = cells_.column(x - radius);
    const int right = cells_.column(x + radius);
    const int last = cells_.row(y + radius);
    for (int row = cells_.row(y - radius); row <= last; ++row) {
      const int first = row * cells_.columns() + left;
      const int last_cell = row * cells_.columns() + right;
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
  Cells cells_;
  Buckets points_;  // indices of the points, sorted by cell
};

}  // namespace ktgp_orb::util
