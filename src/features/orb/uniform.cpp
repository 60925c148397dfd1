#include "features/orb/uniform.h"

#include <algorithm>
#include <cmath>

#include "features/orb/detector.h"

namespace ktgp_orb::orb {
namespace {

// Returns true if `a` comes before `b`: the higher response first; if equal, the upper and then the
// left keypoint.
bool isBetter(const cv::KeyPoint& a, const cv::KeyPoint& b) {
  if (a.response != b.response) return a.response > b.response;
  if (a.pt.y != b.pt.y) return a.pt.y < b.pt.y;
  return a.pt.x < b.pt.x;
}

}  // namespace

LevelCells::LevelCells(const cv::Size& level, int quota, int keypoints_per_cell)
    : width(level.width - 2 * kEdgeMargin), height(level.height - 2 * kEdgeMargin) {
  const double wanted = std::max(1.0, static_cast<double>(quota) / keypoints_per_cell);
  const double side = std::sqrt(static_cast<double>(width) * height / wanted);
  columns = std::max(1, cvRound(width / side));
  rows = std::max(1, cvRound(height / side));
}

int LevelCells::cellOf(const cv::Point2f& point) const {
  const int column = (static_cast<int>(point.x) - kEdgeMargin) * columns / width;
  const int row = (static_cast<int>(point.y) - kEdgeMargin) * rows / height;
  return row * columns + column;
}

UniformChoice::UniformChoice(int features, int strong_score, int keypoints_per_cell, int levels)
    : features_(features),
      keypoints_per_cell_(keypoints_per_cell),
      strong_score_(static_cast<float>(strong_score)),
      levels_(levels) {}

void UniformChoice::sortIntoCells(int level_index, const cv::Size& size, int quota,
                                  std::vector<cv::KeyPoint>& corners) {
  Level& level = levels_[level_index];
  const LevelCells cells(size, quota, keypoints_per_cell_);
  const auto count = static_cast<std::size_t>(cells.count());
  level.corners.sort(corners.size(), 2 * count, [&](std::size_t i) {
    return 2 * cells.cellOf(corners[i].pt) + (corners[i].response < strong_score_ ? 1 : 0);
  });
  level.kept.assign(count, 0);
  level.sorted.clear();
  for (const std::int32_t i : level.corners.order()) level.sorted.push_back(corners[i]);
  corners.swap(level.sorted);
}

void UniformChoice::share(int levels) {
  // Computes the share: the number of corners that each cell may keep. Begins with the cells with
  // the fewest corners. If a cell has fewer corners than its share, the other cells get the rest.
  sizes_.clear();
  for (int i = 0; i < levels; ++i) {
    const Level& level = levels_[i];
    for (std::size_t cell = 0; cell < level.kept.size(); ++cell) {
      sizes_.push_back(level.sizeOf(cell));
    }
  }
  std::sort(sizes_.begin(), sizes_.end());
  std::int64_t left = features_;
  auto cells = static_cast<std::int64_t>(sizes_.size());
  for (const int size : sizes_) {
    if (size * cells > left) break;
    left -= size;
    --cells;
  }
  // If no cell has more corners than its share, every cell keeps all its corners.
  const std::int64_t share = cells > 0 ? left / cells : features_;
  const std::int64_t rest = cells > 0 ? left % cells : 0;
  std::int64_t richer = 0;
  for (int i = 0; i < levels; ++i) {
    Level& level = levels_[i];
    for (std::size_t cell = 0; cell < level.kept.size(); ++cell) {
      const int size = level.sizeOf(cell);
      level.kept[cell] = static_cast<int>(std::min<std::int64_t>(size, share));
      if (size <= share) continue;
      // The remainder is given to some of the richer cells, one corner each. These cells are evenly
      // spaced, as in Bresenham's line algorithm.
      if ((richer + 1) * rest / cells > richer * rest / cells) ++level.kept[cell];
      ++richer;
    }
  }
}

void UniformChoice::keepShares(int level_index, const cv::Mat& image, const OrbKernels& kernels,
                               std::vector<cv::KeyPoint>& corners) {
  Level& level = levels_[level_index];
  level.sorted.clear();
  // Keeps the best corners of a bucket, at most `most`, and returns the number of corners kept.
  const auto keep = [&](std::size_t bucket, int most) {
    const auto first = corners.begin() + level.corners.begin(bucket);
    const auto end = corners.begin() + level.corners.end(bucket);
    const int count = std::min(most, static_cast<int>(end - first));
    if (count > 0) {
      for (auto it = first; it != end; ++it) it->response = harrisResponse(image, kernels, it->pt);
      std::partial_sort(first, first + count, end, isBetter);
    }
    level.sorted.insert(level.sorted.end(), first, first + count);
    return count;
  };
  for (std::size_t cell = 0; cell < level.kept.size(); ++cell) {
    const int strong = keep(2 * cell, level.kept[cell]);
    keep(2 * cell + 1, level.kept[cell] - strong);
  }
  corners.swap(level.sorted);
}

}  // namespace ktgp_orb::orb
