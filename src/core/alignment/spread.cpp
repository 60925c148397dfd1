#include "core/alignment/spread.h"

#include <algorithm>
#include <cmath>

namespace ktgp_orb::alignment {

void PointSpread::choose(const std::vector<Eigen::Vector2d>& points, const cv::Size& image,
                         std::size_t wanted, std::vector<std::uint32_t>& chosen) {
  chosen.clear();
  sortIntoCells(points, image, wanted);
  for (std::uint32_t turn = 0; chosen.size() < wanted; ++turn) {
    round_.clear();
    for (const Cell& cell : cells_) {
      if (turn < cell.size) round_.push_back(order_[cell.first + turn]);
    }
    if (round_.empty()) break;
    const std::size_t count = std::min(round_.size(), wanted - chosen.size());
    for (std::size_t i = 0; i < count; ++i) chosen.push_back(round_[i * round_.size() / count]);
  }
  std::sort(chosen.begin(), chosen.end());
}

void PointSpread::sortIntoCells(const std::vector<Eigen::Vector2d>& points, const cv::Size& image,
                                std::size_t wanted) {
  const double area = static_cast<double>(image.width) * image.height;
  const double side = std::max(1.0, std::sqrt(area / static_cast<double>(wanted)));
  const int columns = static_cast<int>(image.width / side) + 1;
  const int rows = static_cast<int>(image.height / side) + 1;
  const auto number = [side](double x, int count) {
    return static_cast<std::uint32_t>(std::clamp(x / side, 0.0, count - 1.0));
  };
  cells_.assign(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), Cell());
  cell_of_.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    cell_of_[i] = number(points[i].y(), rows) * static_cast<std::uint32_t>(columns) +
                  number(points[i].x(), columns);
    ++cells_[cell_of_[i]].size;
  }
  std::uint32_t first = 0;
  for (Cell& cell : cells_) {
    cell.first = first;
    first += cell.size;
    cell.size = 0;
  }
  order_.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    Cell& cell = cells_[cell_of_[i]];
    order_[cell.first + cell.size++] = static_cast<std::uint32_t>(i);
  }
  for (Cell& cell : cells_) dropTwins(points, cell);
}

void PointSpread::dropTwins(const std::vector<Eigen::Vector2d>& points, Cell& cell) {
  constexpr double kApart = 4.0;  // px
  constexpr std::uint32_t kEnough = 16;
  const auto begin = order_.begin() + cell.first;
  std::uint32_t kept = 0;
  for (std::uint32_t i = 0; i < cell.size && kept < kEnough; ++i) {
    const std::uint32_t candidate = begin[i];
    const bool apart = std::all_of(begin, begin + kept, [&](std::uint32_t other) {
      return (points[candidate] - points[other]).squaredNorm() >= kApart * kApart;
    });
    if (apart) begin[kept++] = candidate;
  }
  cell.size = kept;
}

}  // namespace ktgp_orb::alignment
