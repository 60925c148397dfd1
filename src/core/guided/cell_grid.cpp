#include "core/guided/cell_grid.h"

namespace ktgp_orb {

void CellGrid::build(const std::vector<cv::KeyPoint>& keypoints, const cv::Size& image,
                     double side) {
  per_side_ = 1.0 / side;
  columns_ = static_cast<int>(image.width * per_side_) + 1;
  rows_ = static_cast<int>(image.height * per_side_) + 1;
  start_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0);
  cell_.resize(keypoints.size());
  order_.resize(keypoints.size());
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    const cv::Point2f& p = keypoints[i].pt;
    cell_[i] = static_cast<std::uint32_t>(row(p.y) * columns_ + column(p.x));
    ++start_[cell_[i]];
  }
  std::uint32_t sum = 0;
  for (std::uint32_t& start : start_) start = sum += start;
  // From the back, each cell's end moves to its beginning, and equal cells stay in order.
  for (std::size_t i = keypoints.size(); i-- > 0;) {
    order_[--start_[cell_[i]]] = static_cast<std::int32_t>(i);
  }
}

}  // namespace ktgp_orb
