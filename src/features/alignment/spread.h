#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "util/buckets.h"

namespace ktgp_orb::alignment {

/// Chooses points spread over an image. Keeps its buffers.
class PointSpread {
 public:
  /// Writes the indices of up to `wanted` of the `points` (px) to `chosen`, ascending. The image is
  /// divided into about `wanted` cells. In each round every cell gives its next point, in the order
  /// of the input, until there are enough. If the last round has more points than are needed, the
  /// chosen ones are spread over the cells. If points of a cell nearly coincide, such as a corner
  /// found in several octaves, only the first counts.
  void choose(const std::vector<Eigen::Vector2d>& points, const cv::Size& image, std::size_t wanted,
              std::vector<std::uint32_t>& chosen);

 private:
  void sortIntoCells(const std::vector<Eigen::Vector2d>& points, const cv::Size& image,
                     std::size_t wanted);
  void dropTwins(const std::vector<Eigen::Vector2d>& points);

  util::Buckets cells_;
  std::vector<std::uint32_t> kept_;   // points without twins, cell by cell
  std::vector<std::uint32_t> begin_;  // first index of each cell in kept_, then the end
  std::vector<std::uint32_t> round_;
};

}  // namespace ktgp_orb::alignment
