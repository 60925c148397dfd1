#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "features/orb/kernels.h"
#include "features/orb/teblid_kernel.h"

namespace ktgp_orb::orb {

/// Computes the TEBLID-256 descriptor (see teblid_table.h) of a keypoint from the integral image
/// (cv::integral, CV_32S, modulo 2^32). Writes 32 bytes; the descriptor's first bit is the highest
/// bit of the first byte. The patch of 32 px is scaled to the keypoint's size and rotated by its
/// angle (degrees; negative: not rotated).
///
/// Works for any keypoint. If a box leaves the image, its mean is taken over the part inside the
/// image, or over the nearest pixels if no part is inside. The authors' program (OpenCV's
/// xfeatures2d, scale factor 1) gives the same bits.
///
/// This plain C++ function is the reference for TeblidDescriber.
void describeTeblid(const cv::Mat& integral, const cv::KeyPoint& keypoint,
                    std::uint8_t* descriptor);

/// Computes the TEBLID descriptors of the keypoints of many images. The descriptors equal the
/// output of describeTeblid to the last bit. Keypoints that are far from the border and have the
/// size of their octave are processed fast.
class TeblidDescriber {
 public:
  /// `sizes`: size of the keypoints of each octave, px.
  TeblidDescriber(std::vector<float> sizes, const OrbKernels& kernels);

  /// `image`: 8-bit grey, not empty. Reuses its buffers from image to image.
  void setImage(const cv::Mat& image);
  /// Writes 32 bytes. May be called from several threads at a time.
  void describe(const cv::KeyPoint& keypoint, std::uint8_t* descriptor) const;

 private:
  std::vector<float> sizes_;
  const OrbKernels* kernels_;
  cv::Mat integral_;
  // One entry for each octave; valid only for the row length of integral_.
  std::vector<TeblidScale> scales_;
};

}  // namespace ktgp_orb::orb
