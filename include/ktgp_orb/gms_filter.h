#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb {

/// Options of grid-based motion statistics (Bian et al., CVPR 2017).
struct GmsOptions {
  bool enabled = true;  ///< false: every match passes; not in the paper
  /// T_G, the factor alpha of GMS, in [0, 1e6]: a cell pair survives when the matches in its 3x3
  /// neighbourhood reach T_G * sqrt(mean matches per neighbouring cell). 0 keeps every match whose
  /// reference cell is the one that most matches of its target cell go to.
  double threshold = 6.0;
  bool rotation = false;  ///< also try the other seven 45-degree rotations of the neighbourhood
  bool scale = false;     ///< also try reference grids scaled by 1/2, 1/sqrt 2, sqrt 2 and 2
  int grid_columns = 20;  ///< cells across the target image, 1..200
  int grid_rows = 20;     ///< cells down the target image, 1..200
};

/// What the filter decided and why; every correspondence that took part is in exactly one of the
/// four counts, which are those of the winning rotation and scale.
struct GmsResult {
  std::size_t kept = 0;
  std::size_t outside_grid = 0;   ///< one of its keypoints is in no cell: on or beyond a border
  std::size_t not_best_pair = 0;  ///< in none of the four grids did its cell's best pair contain it
  std::size_t low_support = 0;    ///< its cell pair had too little support in the neighbourhood
  /// How far the target is turned against the reference, clockwise on the screen: 0, 45 ... 315.
  int rotation_degrees = 0;
  /// Cells across the reference image per cell across the target image, i.e. how many times larger
  /// the reference's content appears in the target (for images of equal size).
  double scale = 1.0;
};

/// Removes correspondences that their neighbours do not move along with.
///
/// Each image is divided into cells. In each target cell the reference cell that most of its
/// matches go to is its best pair; the pair is supported when the cells around the one match into
/// the cells around the other (see GmsOptions::threshold). A correspondence is kept when its two
/// cells are a supported best pair in the grid or in one of three copies of it, shifted by half a
/// cell. Of several rotations and scales the one that keeps most wins; the first of equals, in the
/// order scale 1, 1/2, 1/sqrt 2, sqrt 2, 2 and, for each, rotation 0 to 315. The result is equal,
/// match for match, to that of the GMS authors' program; keypoints on or beyond the right and
/// bottom border, which it does not check for, are in no cell here.
///
/// The cost grows with the matches and the cells they occupy, apart from one short pass over the
/// target grid's cells for each of its four copies. Buffers are kept from call to call.
///
/// An instance belongs to one thread at a time; several instances may run side by side.
class GmsFilter {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit GmsFilter(const GmsOptions& options = {});
  ~GmsFilter();
  GmsFilter(GmsFilter&&) noexcept;
  GmsFilter& operator=(GmsFilter&&) noexcept;

  const GmsOptions& options() const;

  /// Raises those of Level::kt that motion statistics support to Level::ktg (all of them where it
  /// is not enabled); others do not take part. The target image is GMS's left image. Throws
  /// std::invalid_argument, before anything is changed, for an image size of zero in a frame that
  /// has keypoints, or where a correspondence that takes part has an index outside its frame.
  GmsResult filter(const Features& reference, const Features& target,
                   std::vector<Correspondence>& correspondences);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
