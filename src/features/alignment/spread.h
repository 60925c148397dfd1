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
  /// cut into about as many cells. Each cell gives one point at a time, in the order of the input,
  /// until there are enough. If not all cells can give another point, those that do are spread,
  /// too. Of nearly coinciding points of a cell, such as a corner found in several octaves, only
  /// the first counts.
  void choose(const std::vector<Eigen::Vector2d>& points, const cv::Size& image, std::size_t wanted,
              std::vector<std::uint32_t>& chosen);

 private:
  void sortIntoCells(const std::vector<Eigen::Vector2d>& points, const cv::Size& image,
                     std::size_t wanted);
  void dropTwins(const std::vector<Eigen::Vector2d>& points);

  util::Buckets cells_;
  std::vector<std::uint32_t> kept_;  // points without twins, cell by cell
  std::vector<std::uint32_t>
      begin_;  // where each cell begins in kept_, and the end of the last one
  std::vector<std::uint32_t> round_;
};

}  // namespace ktgp_orb::alignment
