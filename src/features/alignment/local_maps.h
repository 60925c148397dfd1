#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <utility>
#include <vector>

#include "util/cell_grid.h"

namespace ktgp_orb::alignment {

/// Maps the surroundings of each match to the target without a homography. Keeps its buffers.
class LocalMaps {
 public:
  /// Parallel arrays of matched points, px; `image`: size of the reference.
  void load(const std::vector<Eigen::Vector2d>& reference,
            const std::vector<Eigen::Vector2d>& target, const cv::Size& image);

  /// The affine map around match `i`, as a homography that takes its reference point to its target
  /// point: least squares over the twelve nearest matches in the reference, regularised towards
  /// their similarity. Matches at another depth get less weight.
  Eigen::Matrix3d at(std::size_t i);

 private:
  void findNeighbours(std::size_t i);

  const std::vector<Eigen::Vector2d>* reference_ = nullptr;
  const std::vector<Eigen::Vector2d>* target_ = nullptr;
  double spacing_ = 1.0;  // radius of a disc with about twelve points, px
  util::CellGrid grid_;
  std::vector<std::pair<double, std::int32_t>> near_;  // squared distance and index
};

}  // namespace ktgp_orb::alignment
