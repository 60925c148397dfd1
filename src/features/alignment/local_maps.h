#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <utility>
#include <vector>

#include "util/cell_grid.h"

namespace ktgp_orb::alignment {

/// Computes the affine map from the reference to the target in the neighbourhood of each match. No
/// homography is needed. Reuses its buffers from call to call.
class LocalMaps {
 public:
  /// Parallel arrays of matched points, px; `image`: size of the reference image.
  void load(const std::vector<Eigen::Vector2d>& reference,
            const std::vector<Eigen::Vector2d>& target, const cv::Size& image);

  /// The affine map around match `i`, as a homography that maps its reference point to its target
  /// point. It is fitted by least squares to the twelve nearest matches in the reference, and
  /// regularised towards the similarity map that fits them best. A match with a large deviation,
  /// which may be at another depth, gets less weight.
  Eigen::Matrix3d at(std::size_t i);

 private:
  void findNeighbours(std::size_t i);

  const std::vector<Eigen::Vector2d>* reference_ = nullptr;
  const std::vector<Eigen::Vector2d>* target_ = nullptr;
  double spacing_ = 1.0;  // radius of a disc that contains about twelve points, px
  util::CellGrid grid_;
  // Squared distance (px²) and index of each neighbour.
  std::vector<std::pair<double, std::int32_t>> near_;
};

}  // namespace ktgp_orb::alignment
