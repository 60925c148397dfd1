#include "core/util/cell_grid.h"

namespace ktgp_orb::util {

void CellGrid::divide(const cv::Size& image, double side) {
  constexpr double kMostCells = 1024.0;  // along a side; more would cost more than they save
  per_side_ = 1.0 / std::max(side, std::max(image.width, image.height) / kMostCells);
  columns_ = static_cast<int>(image.width * per_side_) + 1;
  rows_ = static_cast<int>(image.height * per_side_) + 1;
}

}  // namespace ktgp_orb::util
