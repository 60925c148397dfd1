#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "features/orb/kernels.h"
#include "util/buckets.h"

namespace ktgp_orb::orb {

/// A pyramid level without its margin, divided into cells of about `keypoints_per_cell` keypoints,
/// whatever the level's size: so not a CellGrid, whose cells have a side in px.
struct LevelCells {
  /// `level`: size in px, larger than twice kEdgeMargin; `quota`: keypoints wanted from it.
  LevelCells(const cv::Size& level, int quota, int keypoints_per_cell);

  int count() const { return columns * rows; }
  /// Row by row; `point` at least kEdgeMargin px from the border.
  int cellOf(const cv::Point2f& point) const;

  int width;  ///< px in which keypoints may lie
  int height;
  int columns;
  int rows;
};

/// Chooses keypoints so that every part of the image has an equal share.
///
/// Each pyramid level is divided into cells, in proportion to the keypoints wanted from it, so that
/// all cells of all levels have the same share. If a cell has fewer corners, the others get the
/// rest. Within a cell the corners above the full FAST threshold come first, then those with the
/// highest Harris response.
class UniformChoice {
 public:
  /// `features`: keypoints to keep in total; corners of at least `strong_score` come first in their
  /// cell.
  UniformChoice(int features, int strong_score, int keypoints_per_cell, int levels);

  /// Sorts the corners of a level (response: FAST score) by cell. `size` of the level in px,
  /// `quota`: keypoints wanted from it. May be called for different levels from different threads.
  void sortIntoCells(int level, const cv::Size& size, int quota,
                     std::vector<cv::KeyPoint>& corners);
  /// Decides how many each cell keeps, after the levels 0 .. levels - 1 were sorted.
  void share(int levels);
  /// Removes the other corners and sets the Harris response of the rest. Threads: see
  /// sortIntoCells.
  void keepShares(int level, const cv::Mat& image, const OrbKernels& kernels,
                  std::vector<cv::KeyPoint>& corners);

 private:
  struct Level {
    util::Buckets corners;  ///< bucket 2 * cell for the strong ones, plus 1 for the weak ones
    std::vector<int> kept;  ///< corners to keep of each cell; cells row by row
    std::vector<cv::KeyPoint> sorted;

    /// Corners of a cell.
    int sizeOf(std::size_t cell) const {
      return static_cast<int>(corners.end(2 * cell + 1) - corners.begin(2 * cell));
    }
  };

  int features_;
  int keypoints_per_cell_;
  float strong_score_;
  std::vector<Level> levels_;
  std::vector<int> sizes_;  ///< sizes of all cells, ascending
};

}  // namespace ktgp_orb::orb
