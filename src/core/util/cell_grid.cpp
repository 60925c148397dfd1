#include "core/util/cell_grid.h"

namespace ktgp_orb::util {

void CellGrid::divide(const cv::Size& image, double side) {
  constexpr double kMostCells = 1024.0;  // along a side; more would cost more than they save
  per_side_ = 1.0 / std::max(side, std::max(image.width, image.height) / kMostCells);
  columns_ = static_cast<int>(image.width * per_side_) + 1;
  rows_ = static_cast<int>(image.height * per_side_) + 1;
}

void CellGrid::sort() {
  start_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0);
  for (const std::uint32_t cell : cell_) ++start_[cell];
  std::uint32_t sum = 0;
  for (std::uint32_t& start : start_) start = sum += start;
  // From the back: the end of each cell moves to its beginning, and points of a cell stay in order.
  order_.resize(cell_.size());
  for (std::size_t i = cell_.size(); i-- > 0;) {
    order_[--start_[cell_[i]]] = static_cast<std::int32_t>(i);
  }
}

}  // namespace ktgp_orb::util
