#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "features/orb/kernels.h"

namespace ktgp_orb::orb {

/// Source pixels and weights for shrinking a row by linear interpolation, in the fixed point of
/// OpenCV's INTER_LINEAR_EXACT: weights are multiples of 1/256.
struct ResizeAxis {
  ResizeAxis() = default;
  /// `source`, `target`: sizes in px, 1 <= target <= source.
  ResizeAxis(int source, int target);

  int source = 0;
  int target = 0;
  std::vector<ResizeBlock>
      blocks;  ///< kResizeBlock target pixels each; the last block is padded with its last pixel
  bool narrow = false;  ///< whether every block reads at most 16 neighbouring source pixels

  /// The two source pixels of target pixel i, and the weight of the second one, 0..256.
  int firstTap(int i) const;
  int secondTap(int i) const;
  int secondWeight(int i) const;
};

/// Shrinks an 8-bit grey image exactly as cv::resize does with INTER_LINEAR_EXACT, on one thread.
/// Keeps the interpolation weights from image to image.
class Shrinker {
 public:
  /// `target` is not wider or higher than `source`; its buffer is reused if it has the right size.
  void shrink(const cv::Mat& source, const cv::Size& size, const OrbKernels& kernels,
              cv::Mat& target);

 private:
  const std::uint16_t* resizedRow(const cv::Mat& source, int row, const OrbKernels& kernels);

  ResizeAxis columns_;
  ResizeAxis rows_;
  std::vector<std::uint16_t> buffers_[2];
  int buffered_row_[2] = {-1, -1};  // source rows in the buffers
};

struct PyramidLevel {
  cv::Size size;           ///< px
  cv::Mat image;           ///< 8-bit grey; one level is the caller's image itself
  cv::Mat mask;            ///< 8-bit, non-zero where keypoints may lie; empty: everywhere
  float scale = 1.f;       ///< size of the caller's image divided by the size of this level
  int features_quota = 0;  ///< keypoints wanted from this level
};

/// Number of features per level, in proportion to its side length; the last level gets the rest.
std::vector<int> featuresPerLevel(int features, double scale_factor, int levels);

/// The image pyramid. Buffers are kept from image to image.
class OrbPyramid {
 public:
  OrbPyramid(int features, double scale_factor, int levels, int first_level);

  /// Sets `first_level` (without a copy), computes the larger levels from it, and sets the sizes of
  /// the smaller levels. Levels too small for a keypoint are at the end and not used.
  void setImage(const cv::Mat& image, const cv::Mat& mask);
  /// Computes the levels after `first_level`, each from the previous one.
  void shrink(const OrbKernels& kernels);

  /// Reuses the memory of `images` for the computed levels unless it is shared. Never overwrites
  /// images that were handed out before.
  void takeBuffers(std::vector<cv::Mat>& images);
  /// Sets `images` to the caller's image (copied if `copy_first`) and the smaller levels in use,
  /// which are not copied.
  void handOut(bool copy_first, std::vector<cv::Mat>& images) const;

  std::vector<PyramidLevel>& levels() { return levels_; }
  /// Levels that can hold keypoints in this image.
  int used() const { return used_; }

 private:
  std::vector<PyramidLevel> levels_;
  std::vector<Shrinker> shrinkers_;  // shrinker i makes level i + 1 from level i
  int first_level_;                  // index in levels_ of the level of the caller's image
  int used_ = 0;
};

}  // namespace ktgp_orb::orb
