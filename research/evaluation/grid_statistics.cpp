#include "evaluation/grid_statistics.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "util/keypoint_position.h"

namespace ktgp_orb::evaluation {
namespace {

constexpr int kNoCell = -1;

/// `grid`: columns and rows of cells in an image.
int neighbour(const cv::Size& grid, int cell, const cv::Point& offset) {
  const cv::Point at = cv::Point(cell % grid.width, cell / grid.width) + offset;
  return at.inside({{0, 0}, grid}) ? at.y * grid.width + at.x : kNoCell;
}

/// The cell of a keypoint in a grid shifted by `shift` half cells. Such a grid does not use its
/// first column and row.
int cellOf(const cv::Size& grid, const Features& features, std::int32_t index,
           const cv::Point& shift) {
  const cv::Point2f& p = util::imagePoint(features, index);
  const float x = p.x / static_cast<float>(features.image_size.width);
  const float y = p.y / static_cast<float>(features.image_size.height);
  const double column = std::floor(x * static_cast<float>(grid.width) + 0.5 * shift.x);
  const double row = std::floor(y * static_cast<float>(grid.height) + 0.5 * shift.y);
  const bool inside =
      column >= shift.x && column < grid.width && row >= shift.y && row < grid.height;
  return inside ? static_cast<int>(row) * grid.width + static_cast<int>(column) : kNoCell;
}

/// The matches of one shifted grid, counted per target cell and per pair of cells.
class CellCounts {
 public:
  explicit CellCounts(const cv::Size& grid)
      : grid_(grid),
        pair_(static_cast<std::size_t>(grid.area()) * static_cast<std::size_t>(grid.area())),
        target_(static_cast<std::size_t>(grid.area())) {}

  void add(int target, int reference) {
    ++pair_[at(target, reference)];
    ++target_[static_cast<std::size_t>(target)];
  }

  /// The reference cell with the most matches of the target cell; of equal cells, the first.
  int best(int target) const {
    const auto row = pair_.begin() + static_cast<std::ptrdiff_t>(at(target, 0));
    const auto best = std::max_element(row, row + grid_.area());
    return *best > 0 ? static_cast<int>(best - row) : kNoCell;
  }

  bool isSupported(int target, int reference, const Neighbourhood& around, double factor) const {
    int support = 0;
    int matches = 0;
    int cells = 0;
    for (const cv::Point& offset : around) {
      const int t = neighbour(grid_, target, offset);
      const int r = neighbour(grid_, reference, offset);
      if (t == kNoCell || r == kNoCell) continue;
      support += pair_[at(t, r)];
      matches += target_[static_cast<std::size_t>(t)];
      ++cells;
    }
    return support >= factor * std::sqrt(static_cast<double>(matches) / cells);
  }

 private:
  std::size_t at(int target, int reference) const {
    return static_cast<std::size_t>(target) * static_cast<std::size_t>(grid_.area()) +
           static_cast<std::size_t>(reference);
  }

  cv::Size grid_;
  std::vector<int> pair_;
  std::vector<int> target_;
};

/// The best reference cell of each target cell if it is supported, else kNoCell.
std::vector<int> supportedCells(const CellCounts& counts, const cv::Size& grid,
                                const Neighbourhood& neighbourhood, double factor) {
  std::vector<int> supported(static_cast<std::size_t>(grid.area()), kNoCell);
  for (int target = 0; target < grid.area(); ++target) {
    const int best = counts.best(target);
    if (best == kNoCell || !counts.isSupported(target, best, neighbourhood, factor)) continue;
    supported[static_cast<std::size_t>(target)] = best;
  }
  return supported;
}

}  // namespace

Neighbourhood square(int radius) {
  Neighbourhood cells;
  for (int y = -radius; y <= radius; ++y) {
    for (int x = -radius; x <= radius; ++x) cells.emplace_back(x, y);
  }
  return cells;
}

Neighbourhood cross() {
  return {{0, 0}, {-1, 0}, {1, 0}, {0, -1}, {0, 1}};
}

void filterByGridStatistics(const Features& reference, const Features& target,
                            const Neighbourhood& neighbourhood, const GmsOptions& options,
                            std::vector<Correspondence>& matches) {
  if (options.grid_columns < 1 || options.grid_rows < 1) {
    throw std::invalid_argument(
        "gms_grid is 0, by the number of matches; this method expects the number of cells, 1 or "
        "more");
  }
  const cv::Size grid{options.grid_columns, options.grid_rows};
  std::vector<bool> keep(matches.size(), false);
  for (const cv::Point& shift : {cv::Point(0, 0), {1, 0}, {0, 1}, {1, 1}}) {
    CellCounts counts(grid);
    std::vector<std::pair<int, int>> cells;
    cells.reserve(matches.size());
    for (const Correspondence& c : matches) {
      cells.emplace_back(cellOf(grid, target, c.target_index, shift),
                         cellOf(grid, reference, c.reference_index, {0, 0}));
      const auto& [t, r] = cells.back();
      if (t != kNoCell && r != kNoCell) counts.add(t, r);
    }
    const std::vector<int> supported =
        supportedCells(counts, grid, neighbourhood, options.threshold);
    for (std::size_t i = 0; i < matches.size(); ++i) {
      const auto& [t, r] = cells[i];
      if (t == kNoCell || r == kNoCell) continue;
      if (supported[static_cast<std::size_t>(t)] == r) keep[i] = true;
    }
  }
  std::size_t i = 0;
  matches.erase(std::remove_if(matches.begin(), matches.end(),
                               [&](const Correspondence&) { return !keep[i++]; }),
                matches.end());
}

}  // namespace ktgp_orb::evaluation
