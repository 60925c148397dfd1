#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/orb/kernels.h"

namespace ktgp_orb::orb {

/// Source pixels and weights for shrinking a row by linear interpolation, in the fixed point of
/// OpenCV's INTER_LINEAR_EXACT: weights are multiples of 1/256.
struct ResizeAxis {
  ResizeAxis() = default;
  /// Both in px, 1 <= target <= source.
  ResizeAxis(int source, int target);

  int source = 0;
  int target = 0;
  std::vector<ResizeBlock>
      blocks;  ///< of kResizeBlock target pixels; the last one is padded with its last pixel
  bool narrow = false;  ///< every block reads at most 16 neighbouring source pixels

  /// The two source pixels of target pixel i and the weight of the second, 0..256.
  int firstTap(int i) const;
  int secondTap(int i) const;
  int secondWeight(int i) const;
};

/// Shrinks an 8-bit grey image exactly as cv::resize with INTER_LINEAR_EXACT, on one thread. Keeps
/// the interpolation weights from image to image.
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

}  // namespace ktgp_orb::orb
