#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/orb/kernels.h"

namespace ktgp_orb::orb {

/// How the pixels of a shorter row come from a longer one by linear interpolation, in the fixed
/// point of OpenCV's INTER_LINEAR_EXACT: weights are multiples of 1/256.
struct ResizeAxis {
  ResizeAxis() = default;
  /// Both in px, 1 <= target <= source.
  ResizeAxis(int source, int target);

  int source = 0;
  int target = 0;
  std::vector<ResizeBlock> blocks;  ///< of kResizeBlock target pixels; the last repeats its last
  bool narrow = false;              ///< every block reads 16 neighbouring source pixels at most

  /// The two source pixels of target pixel i and the weight of the second, 0..256.
  int firstTap(int i) const;
  int secondTap(int i) const;
  int secondWeight(int i) const;
};

/// Resizes an 8-bit grey image exactly as cv::resize with INTER_LINEAR_EXACT, for shrinking; on one
/// thread, and without computing the interpolation weights anew for every image.
class Shrinker {
 public:
  /// `target` is no wider and no higher than `source`; its buffer is reused where it is the size
  /// wanted.
  void shrink(const cv::Mat& source, const cv::Size& size, const OrbKernels& kernels,
              cv::Mat& target);

 private:
  const std::uint16_t* resizedRow(const cv::Mat& source, int row, const OrbKernels& kernels);

  ResizeAxis columns_;
  ResizeAxis rows_;
  std::vector<std::uint16_t> buffers_[2];
  int buffered_row_[2] = {-1, -1};  // source rows that the buffers hold
};

}  // namespace ktgp_orb::orb
