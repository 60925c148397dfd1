#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

namespace ktgp_orb::alignment {

/// Chooses points that lie spread over an image. Keeps its buffers.
class PointSpread {
 public:
  /// Up to `wanted` of `points` (px), as places in ascending order, into `chosen`. The image is cut
  /// into about as many cells; each gives one point at a time, the earlier ones first, until there
  /// are enough. Where not all cells can give another, those that do lie spread too. Of points of a
  /// cell that nearly coincide, such as a corner found in several octaves, the first counts.
  void choose(const std::vector<Eigen::Vector2d>& points, const cv::Size& image, std::size_t wanted,
              std::vector<std::uint32_t>& chosen);

 private:
  struct Cell {
    std::uint32_t first = 0;  ///< place in order_
    std::uint32_t size = 0;
  };

  void sortIntoCells(const std::vector<Eigen::Vector2d>& points, const cv::Size& image,
                     std::size_t wanted);
  void dropTwins(const std::vector<Eigen::Vector2d>& points, Cell& cell);

  std::vector<std::uint32_t> cell_of_;
  std::vector<Cell> cells_;
  std::vector<std::uint32_t> order_;  // points, cell by cell
  std::vector<std::uint32_t> round_;
};

}  // namespace ktgp_orb::alignment
