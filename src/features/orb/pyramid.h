#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "features/orb/kernels.h"

namespace ktgp_orb::orb {

/// Source pixels and weights for shrinking a row by linear interpolation. The weights are multiples
/// of 1/256, as in the fixed-point arithmetic of OpenCV's INTER_LINEAR_EXACT.
struct ResizeAxis {
  ResizeAxis() = default;
  /// `source`, `target`: sizes in px, 1 <= target <= source.
  ResizeAxis(int source, int target);

  int source = 0;
  int target = 0;
  /// Each block has kResizeBlock target pixels; the last block is padded with its last pixel.
  std::vector<ResizeBlock> blocks;
  bool narrow = false;  ///< true if every block reads at most 16 neighbouring source pixels

  /// The two source pixels of target pixel i, and the weight of the second one, 0..256.
  int firstTap(int i) const;
  int secondTap(int i) const;
  int secondWeight(int i) const;
};

/// Shrinks an 8-bit grey image exactly as cv::resize does with INTER_LINEAR_EXACT, on one thread.
/// Keeps the interpolation weights from image to image.
class Shrinker {
 public:
  /// `size` is not wider or higher than `source`. The buffer of `target` is reused if it has the
  /// right size.
  void shrink(const cv::Mat& source, const cv::Size& size, const OrbKernels& kernels,
              cv::Mat& target);

 private:
  const std::uint16_t* resizedRow(const cv::Mat& source, int row, const OrbKernels& kernels);

  ResizeAxis columns_;
  ResizeAxis rows_;
  std::vector<std::uint16_t> buffers_[2];
  int buffered_row_[2] = {-1, -1};  // source row in each of the two buffers; -1: none
};

struct PyramidLevel {
  cv::Size size;           ///< px
  cv::Mat image;           ///< 8-bit grey; one level is the caller's image itself
  cv::Mat mask;            ///< 8-bit, non-zero where keypoints may lie; empty: everywhere
  float scale = 1.f;       ///< size of the caller's image divided by the size of this level
  int features_quota = 0;  ///< number of keypoints wanted from this level
};

/// Number of features that each level should have, in proportion to the side length of the level.
/// The last level gets the rest.
std::vector<int> featuresPerLevel(int features, double scale_factor, int levels);

/// The image pyramid. Reuses its buffers from image to image.
class OrbPyramid {
 public:
  OrbPyramid(int features, double scale_factor, int levels, int first_level);

  /// Sets level `first_level` to `image` (without a copy), computes the larger levels from it, and
  /// sets the sizes of the smaller levels. Levels that are too small for a keypoint are at the end
  /// of the list and are not used.
  void setImage(const cv::Mat& image, const cv::Mat& mask);
  /// Computes the levels after `first_level`, each from the previous one.
  void shrink(const OrbKernels& kernels);

  /// Reuses the memory of `images` for the computed levels. Memory that another matrix shares is
  /// not reused, so images that were handed out before are never overwritten.
  void takeBuffers(std::vector<cv::Mat>& images);
  /// Sets `images` to the caller's image (copied if `copy_first`) and to the smaller levels in use.
  /// The smaller levels are not copied.
  void handOut(bool copy_first, std::vector<cv::Mat>& images) const;

  std::vector<PyramidLevel>& levels() { return levels_; }
  /// Number of levels that are large enough for keypoints.
  int used() const { return used_; }

 private:
  std::vector<PyramidLevel> levels_;
  std::vector<Shrinker> shrinkers_;  // shrinker i computes level i + 1 from level i
  int first_level_;                  // index in levels_ of the level that is the caller's image
  int used_ = 0;
};

}  // namespace ktgp_orb::orb
