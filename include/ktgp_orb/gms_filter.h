#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb {

/// Options of grid-based motion statistics (Bian et al., CVPR 2017).
struct GmsOptions {
  bool enabled = true;  ///< if false, every match passes; this switch is not in the paper
  /// T_G, the factor alpha of GMS, in [0, 1e6]: a cell pair survives if its 3x3 neighbourhood has
  /// at least T_G * sqrt(mean number of matches per neighbouring cell) matches. 0 keeps every match
  /// in the best cell pair of its target cell.
  double threshold = 6.0;
  bool rotation = false;  ///< also try the other seven 45-degree rotations of the neighbourhood
  bool scale = false;     ///< also try reference grids scaled by 1/2, 1/sqrt 2, sqrt 2 and 2
  /// Number of cells across the target image, 1..200. If it is 0, GmsFilter chooses between 5 and
  /// 20 cells, so that a cell has 2.5 matches on average, as on the paper's grid of 20 x 20 cells
  /// with 1000 matches. On a finer grid, few matches would have no neighbours to support them.
  int grid_columns = 20;
  /// Number of cells down the target image; if 0, it is chosen like `grid_columns`.
  int grid_rows = 20;
};

/// How many matches were kept or removed, and why, for the winning rotation and scale. Every match
/// of Level::kt is counted in exactly one of the four counts.
struct GmsResult {
  std::size_t kept = 0;
  /// Number of matches with a keypoint on or beyond the border of the grid, where there are no
  /// cells.
  std::size_t outside_grid = 0;
  /// Number of matches that do not belong to the best pair of their target cell in any of the four
  /// grids.
  std::size_t not_best_pair = 0;
  /// Number of matches whose cell pair has too few matches in the neighbouring cells.
  std::size_t low_support = 0;
  /// Rotation of the target relative to the reference, degrees clockwise on screen: 0, 45 ... 315.
  int rotation_degrees = 0;
  /// Number of cells across the reference image, divided by the number of cells across the target
  /// image. For images of equal size, the content of the reference appears larger in the target by
  /// this factor.
  double scale = 1.0;
};

/// Removes correspondences that do not move like their neighbours.
///
/// Each image is divided into cells. The best pair of a target cell is this cell and the reference
/// cell with which it shares the most matches. A best pair is supported if enough matches lead from
/// the cells around the target cell to the cells around the reference cell (see
/// GmsOptions::threshold). A correspondence is kept if its two cells are a supported best pair in
/// the grid, or in one of three copies shifted by half a cell. Among several rotations and scales,
/// the combination that keeps the most matches wins. If two combinations keep equally many matches,
/// the earlier one wins; the order is scale 1, 1/2, 1/sqrt 2, sqrt 2, 2 and, for each scale,
/// rotation 0 to 315. The GMS authors' program gives the same result, match for match. Their
/// program does not check for keypoints on or beyond the right and bottom border; in this class,
/// such keypoints belong to no cell.
///
/// The matches are sorted by their pair of cells. The time therefore grows with the number of
/// matches and the number of cells that contain matches. In addition, there is a short pass over
/// the cells of the target grid for each of its four copies and each scale. Buffers are reused from
/// call to call.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class GmsFilter {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit GmsFilter(const GmsOptions& options = {});
  ~GmsFilter();
  GmsFilter(GmsFilter&&) noexcept;
  GmsFilter& operator=(GmsFilter&&) noexcept;

  const GmsOptions& options() const;

  /// Raises a match from Level::kt to Level::ktg if motion statistics support it. If the filter is
  /// off, all matches of Level::kt are raised to Level::ktg, except those of keypoints whose
  /// position is NaN (see Lens::rectify). Matches of other levels are ignored. The target image is
  /// what the GMS paper calls the left image. Throws std::invalid_argument, before any change, if a
  /// frame with keypoints has an empty image size, or if a match has an index that its frame does
  /// not have.
  GmsResult filter(const Features& reference, const Features& target,
                   std::vector<Correspondence>& correspondences);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
