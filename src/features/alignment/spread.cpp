#include "features/alignment/spread.h"

#include <algorithm>
#include <cmath>

#include "util/cells.h"

namespace ktgp_orb::alignment {

void PointSpread::choose(const std::vector<Eigen::Vector2d>& points, const cv::Size& image,
                         std::size_t wanted, std::vector<std::uint32_t>& chosen) {
  chosen.clear();
  sortIntoCells(points, image, wanted);
  dropTwins(points);
  for (std::uint32_t turn = 0; chosen.size() < wanted; ++turn) {
    round_.clear();
    for (std::size_t cell = 0; cell + 1 < begin_.size(); ++cell) {
      const std::uint32_t place = begin_[cell] + turn;
      if (place < begin_[cell + 1]) round_.push_back(kept_[place]);
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
  const util::Cells cells(image, side);
  begin_.resize(cells.count() + 1);
  cells_.sort(points.size(), cells.count(),
              [&](std::size_t i) { return cells.at(points[i].x(), points[i].y()); });
}

void PointSpread::dropTwins(const std::vector<Eigen::Vector2d>& points) {
  constexpr double kApart = 4.0;  // px
  constexpr std::size_t kEnough = 16;
  kept_.clear();
  for (std::size_t cell = 0; cell + 1 < begin_.size(); ++cell) {
    const std::size_t first = kept_.size();
    begin_[cell] = static_cast<std::uint32_t>(first);
    const std::uint32_t end = cells_.end(cell);
    for (std::uint32_t i = cells_.begin(cell); i < end && kept_.size() < first + kEnough; ++i) {
      const auto candidate = static_cast<std::uint32_t>(cells_.order()[i]);
      const auto is_apart = [&](std::uint32_t other) {
        return (points[candidate] - points[other]).squaredNorm() >= kApart * kApart;
      };
      const auto begin = kept_.begin() + static_cast<std::ptrdiff_t>(first);
      if (std::all_of(begin, kept_.end(), is_apart)) kept_.push_back(candidate);
    }
  }
  begin_.back() = static_cast<std::uint32_t>(kept_.size());
}

}  // namespace ktgp_orb::alignment
