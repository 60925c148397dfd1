#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "features/orb/kernels.h"
#include "util/buckets.h"

namespace ktgp_orb::orb {

/// A pyramid level without its margin, divided into cells of about `keypoints_per_cell` keypoints
/// each. (CellGrid is not used here, because its cells are squares of a given side in px.)
struct LevelCells {
  /// `level`: size of the level in px, larger than twice kEdgeMargin; `quota`: number of keypoints
  /// wanted from the level.
  LevelCells(const cv::Size& level, int quota, int keypoints_per_cell);

  int count() const { return columns * rows; }
  /// Index of the cell with this point; cells are counted row by row. `point` must be at least
  /// kEdgeMargin px from the border.
  int cellOf(const cv::Point2f& point) const;

  int width;  ///< width and height of the area in which keypoints may lie, px
  int height;
  int columns;
  int rows;
};

/// Chooses keypoints so that every part of the image gets an equal share of them.
///
/// The number of cells of a pyramid level is in proportion to the number of keypoints wanted from
/// the level, so that all cells of all levels have the same share. If a cell has fewer corners than
/// its share, the other cells share the rest. Within a cell, corners above the full FAST threshold
/// come before the other corners, and both groups are sorted by Harris response.
class UniformChoice {
 public:
  /// `features`: number of keypoints to keep in total. In each cell, corners with a FAST score of
  /// at least `strong_score` come first.
  UniformChoice(int features, int strong_score, int keypoints_per_cell, int levels);

  /// Sorts the corners of a level (response: FAST score) by cell. `size`: size of the level in px.
  /// `quota`: number of keypoints wanted from the level. May be called for different levels from
  /// different threads.
  void sortIntoCells(int level, const cv::Size& size, int quota,
                     std::vector<cv::KeyPoint>& corners);
  /// Decides how many corners each cell keeps, after the levels 0 .. levels - 1 were sorted.
  void share(int levels);
  /// Keeps the best corners of each cell, and sets their response to the Harris response. May be
  /// called for different levels from different threads.
  void keepShares(int level, const cv::Mat& image, const OrbKernels& kernels,
                  std::vector<cv::KeyPoint>& corners);

 private:
  struct Level {
    /// Bucket 2 * cell has the strong corners, bucket 2 * cell + 1 the weak corners.
    util::Buckets corners;
    /// Number of corners to keep in each cell; the cells are ordered row by row.
    std::vector<int> kept;
    std::vector<cv::KeyPoint> sorted;

    /// Number of corners of a cell.
    int sizeOf(std::size_t cell) const {
      return static_cast<int>(corners.end(2 * cell + 1) - corners.begin(2 * cell));
    }
  };

  int features_;
  int keypoints_per_cell_;
  float strong_score_;
  std::vector<Level> levels_;
  std::vector<int> sizes_;  ///< numbers of corners of all cells, ascending
};

}  // namespace ktgp_orb::orb
