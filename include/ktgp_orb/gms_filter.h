#pragma once

#include <cstddef>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb {

/// Options of grid-based motion statistics (Bian et al., CVPR 2017).
struct GmsOptions {
  double threshold = 6.0;  ///< T_G, the factor alpha of GMS, >= 0; 0 keeps all in a cell pair
  bool rotation = false;   ///< also try the eight 45-degree rotations of the neighbourhood
  bool scale = false;      ///< also try reference grids scaled by 1/2, 1/sqrt 2, sqrt 2 and 2
  int grid_columns = 20;   ///< cells across the target image, 1..200
  int grid_rows = 20;      ///< cells down the target image, 1..200
};

/// What the filter decided and why; every input correspondence is in exactly one of the counts.
struct GmsResult {
  std::size_t kept = 0;
  std::size_t outside_grid = 0;   ///< in no cell, in all four shifted grids: on or beyond a border
  std::size_t not_best_pair = 0;  ///< in no grid did its cell's best pair contain it
  std::size_t low_support = 0;    ///< its cell pair had too little support in the neighbourhood
  int rotation_degrees = 0;       ///< the winning rotation of the neighbourhood, multiple of 45
  double scale = 1.0;             ///< the winning scale of the reference grid
};

/// Removes correspondences that their neighbours do not move along with.
class GmsFilter {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit GmsFilter(const GmsOptions& options = {});

  /// Raises those of Level::kt that motion statistics support to Level::ktg; others do not take
  /// part. The target image is GMS's left image. Throws std::invalid_argument for an image size of
  /// zero or an index outside its frame.
  GmsResult filter(const Features& reference, const Features& target,
                   std::vector<Correspondence>& correspondences);

 private:
  GmsOptions options_;
};

}  // namespace ktgp_orb
