#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/orb/teblid_kernel.h"

namespace ktgp_orb::orb {

/// Sizes of ORB's keypoints by octave, in px: `patch` at full resolution.
std::vector<float> keypointSizes(float patch, double scale_factor, int levels);

/// TEBLID descriptors of the keypoints of many images: equal to describeTeblid, to the last bit,
/// and fast for keypoints far from the border that have the size of their octave.
class TeblidDescriber {
 public:
  /// `sizes` of keypoints, in px, by octave.
  explicit TeblidDescriber(std::vector<float> sizes,
                           const TeblidKernel& kernel = bestTeblidKernel());

  /// `image`: 8-bit grey, not empty. Buffers are kept from image to image.
  void setImage(const cv::Mat& image);
  /// 32 bytes. May be called from several threads at a time.
  void describe(const cv::KeyPoint& keypoint, std::uint8_t* descriptor) const;

 private:
  std::vector<float> sizes_;
  const TeblidKernel* kernel_;
  cv::Mat integral_;
  std::vector<TeblidScale> scales_;  // by octave, for rows as long as those of integral_
};

}  // namespace ktgp_orb::orb
