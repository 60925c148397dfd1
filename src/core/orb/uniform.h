#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/orb/kernels.h"

namespace ktgp_orb::orb {

/// A pyramid level without its margin, divided into cells of about `keypoints_per_cell` keypoints.
class CellGrid {
 public:
  CellGrid() = default;
  /// `size` of the level in px, larger than twice kEdgeMargin; `quota`: keypoints wanted from it.
  CellGrid(const cv::Size& size, int quota, int keypoints_per_cell);

  int cells() const { return columns_ * rows_; }
  /// Row by row; `point` at least kEdgeMargin px from the border.
  int cellOf(const cv::Point2f& point) const;

 private:
  int width_ = 0;  // px in which keypoints may lie
  int height_ = 0;
  int columns_ = 0;
  int rows_ = 0;
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
  struct Cell {
    int first = 0;  ///< begin of its strong corners
    int weak = 0;   ///< begin of the weak ones
    int last = 0;   ///< end
    int kept = 0;   ///< corners to keep
    int size() const { return last - first; }
  };
  struct Level {
    std::vector<Cell> cells;  ///< row by row
    std::vector<int> bucket;  ///< of each corner: 2 * cell, plus 1 for a weak one
    std::vector<int> begin;   ///< of each bucket
    std::vector<cv::KeyPoint> sorted;
  };

  int features_;
  int keypoints_per_cell_;
  float strong_score_;
  std::vector<Level> levels_;
};

}  // namespace ktgp_orb::orb
