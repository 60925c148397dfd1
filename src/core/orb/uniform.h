#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/orb/kernels.h"

namespace ktgp_orb::orb {

/// A pyramid level cut into cells of about `keypoints_per_cell` keypoints, less its margin.
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

/// Chooses keypoints so that every part of the image keeps an equal share of them.
///
/// Each pyramid level is cut into cells, their number in proportion to the keypoints wanted from
/// it, so that all cells of all levels have the same share. A cell with fewer corners leaves the
/// rest to the others. Within a cell those that pass the full FAST threshold come first, then those
/// of highest Harris response.
class UniformChoice {
 public:
  /// `features` to keep in all; corners of at least `strong_score` come first in their cell.
  UniformChoice(int features, int strong_score, int keypoints_per_cell, int levels);

  /// Orders the corners of a level (response: FAST score) by cell. `size` of the level in px,
  /// `quota`: keypoints wanted from it. Different levels may be given from different threads.
  void sortIntoCells(int level, const cv::Size& size, int quota,
                     std::vector<cv::KeyPoint>& corners);
  /// Decides how many each cell keeps, once the levels 0 .. levels - 1 have been sorted.
  void share(int levels);
  /// Removes the other corners and sets the Harris response of those kept. As sortIntoCells.
  void keepShares(int level, const cv::Mat& image, const OrbKernels& kernels,
                  std::vector<cv::KeyPoint>& corners);

 private:
  struct Cell {
    int first = 0;  ///< its corners: the strong ones from here
    int weak = 0;   ///< the weak ones from here
    int last = 0;   ///< to here
    int kept = 0;   ///< its share
    int size() const { return last - first; }
  };
  struct Level {
    std::vector<Cell> cells;  ///< row by row
    std::vector<int> bucket;  ///< of each corner: 2 * cell, plus 1 where it is weak
    std::vector<int> begin;   ///< of each bucket
    std::vector<cv::KeyPoint> sorted;
  };

  int features_;
  int keypoints_per_cell_;
  float strong_score_;
  std::vector<Level> levels_;
};

}  // namespace ktgp_orb::orb
