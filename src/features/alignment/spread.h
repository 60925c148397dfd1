#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "util/buckets.h"

namespace ktgp_orb::alignment {

/// Chooses points spread over an image. Reuses its buffers from call to call.
class PointSpread {
 public:
  /// Writes the indices of up to `wanted` of the `points` (px) to `chosen`, ascending. The image is
  /// divided into about `wanted` cells. In each round, the next point of every cell is chosen, in
  /// the order of the input, until there are enough points. If the last round has more points than
  /// are needed, the points are taken from cells spread over the image. If points of a cell nearly
  /// coincide, for example because a corner was found in several octaves, only the first point
  /// counts.
  void choose(const std::vector<Eigen::Vector2d>& points, const cv::Size& image, std::size_t wanted,
              std::vector<std::uint32_t>& chosen);

 private:
  void sortIntoCells(const std::vector<Eigen::Vector2d>& points, const cv::Size& image,
                     std::size_t wanted);
  void dropTwins(const std::vector<Eigen::Vector2d>& points);

  util::Buckets cells_;
  // Indices of the points that do not coincide with an earlier point, cell by cell.
  std::vector<std::uint32_t> kept_;
  // Index in kept_ at which each cell begins; the last entry is the size of kept_.
  std::vector<std::uint32_t> begin_;
  std::vector<std::uint32_t> round_;
};

}  // namespace ktgp_orb::alignment
