#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <utility>
#include <vector>

#include "util/cell_grid.h"

namespace ktgp_orb::alignment {

/// How the surroundings of every match are mapped from reference to target, where there is no
/// homography. Keeps its buffers.
class LocalMaps {
 public:
  /// Parallel arrays of matched points, px; `image`: size of the reference.
  void load(const std::vector<Eigen::Vector2d>& reference,
            const std::vector<Eigen::Vector2d>& target, const cv::Size& image);

  /// The affine map around match `i`, as a homography that takes its reference point to its target
  /// point: least squares over the twelve matches next to it in the reference, drawn towards their
  /// similarity. Matches of another depth get less weight.
  Eigen::Matrix3d at(std::size_t i);

 private:
  void findNeighbours(std::size_t i);

  const std::vector<Eigen::Vector2d>* reference_ = nullptr;
  const std::vector<Eigen::Vector2d>* target_ = nullptr;
  double spacing_ = 1.0;  // radius of a disc with about as many points as are wanted, px
  util::CellGrid grid_;
  std::vector<std::pair<double, std::int32_t>> near_;  // squared distance and index
};

}  // namespace ktgp_orb::alignment
