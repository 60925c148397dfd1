#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <opencv2/core/types.hpp>

namespace ktgp_orb::util {

/// Divides a rectangle into square cells, which are counted row by row. A point outside the
/// rectangle belongs to the nearest cell; a NaN coordinate counts as the left or upper border.
class Cells {
 public:
  Cells() = default;
  /// `low`: left upper corner of the rectangle. `size`: its width and height; negative ones count
  /// as 0. `side`: side of a cell, above 0. `most`: largest number of cells along an axis; if this
  /// is not enough, the last cell also holds all points beyond it.
  Cells(const Eigen::Vector2d& low, const Eigen::Vector2d& size, double side, int most)
      : low_(low), side_(side) {
    columns_ = clamped(size.x(), most) + 1;
    rows_ = clamped(size.y(), most) + 1;
  }
  /// Cells of an image, px; as many as it needs.
  Cells(const cv::Size& image, double side)
      : Cells(Eigen::Vector2d::Zero(), {image.width, image.height}, side,
              std::numeric_limits<int>::max()) {}

  int columns() const { return columns_; }
  std::size_t count() const {
    return static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  }
  int column(double x) const { return clamped(x - low_.x(), columns_); }
  int row(double y) const { return clamped(y - low_.y(), rows_); }
  /// Index of the cell with this point, below count().
  std::size_t at(double x, double y) const {
    return static_cast<std::size_t>(row(y)) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column(x));
  }

 private:
  int clamped(double length, int count) const {
    const double cell = length / side_;
    // NaN makes this comparison false, so it gets cell 0.
    return cell >= 1.0 ? static_cast<int>(std::min(cell, count - 1.0)) : 0;
  }

  Eigen::Vector2d low_ = Eigen::Vector2d::Zero();
  double side_ = 1.0;
  int columns_ = 1;
  int rows_ = 1;
};

}  // namespace ktgp_orb::util
