#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "features/alignment/kernels.h"

namespace ktgp_orb::alignment {

enum class PatchOutcome : std::uint8_t {
  aligned,
  outside,       ///< the patch, or its search window in the target, leaves the image
  distorted,     ///< H mirrors, compresses or stretches it too much
  textureless,   ///< too little texture to locate it, in one direction or both
  unsettled,     ///< the steps did not become small
  beyond_reach,  ///< it moved too far from the prediction of H
  uncorrelated,  ///< the patch found looks different
};

struct AlignedPatch {
  PatchOutcome outcome = PatchOutcome::outside;
  Eigen::Vector2d reference = Eigen::Vector2d::Zero();  ///< px, the centre of the patch
  Eigen::Vector2d target = Eigen::Vector2d::Zero();     ///< px, its position there
  double correlation = 0.0;                             ///< NCC², 0..1
  double rounding2 = 0.0;  ///< variance of the position, px², per coordinate, that comes from grey
                           ///< values being whole numbers
};

/// Registers single patches of the reference in the target: translation by inverse-compositional
/// least squares (Baker & Matthews, IJCV 2004) with gain and bias projected out; the patch is
/// warped by the local affine part of H (as in SVO; Forster et al., ICRA 2014).
class PatchAligner {
 public:
  explicit PatchAligner(const AlignmentKernels& kernels) : kernels_(kernels) {}

  /// The grey image pyramids, level 0 first; stored by reference. False if one of them has no
  /// image: then nothing can be aligned.
  bool setImages(const std::vector<cv::Mat>& reference, const std::vector<cv::Mat>& target);

  /// `point`: px in the reference; the patch is centred between the four nearest pixels. `reach`:
  /// px of the target's level, up to (kWindowSide - kPatchSide) / 2 - 2.
  AlignedPatch align(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point, double reach);

 private:
  bool takePatch(const cv::Mat& level, const Eigen::Vector2d& centre,
                 const Eigen::Matrix2d& target_to_reference);
  PatchOutcome settle(const cv::Mat& level, double reach, Eigen::Vector2d& position,
                      AlignedPatch& result);

  const AlignmentKernels& kernels_;
  const std::vector<cv::Mat>* reference_ = nullptr;
  const std::vector<cv::Mat>* target_ = nullptr;
  PatchTemplate template_;
  alignas(64) float patch_[kWarpSide * kWarpPitch];
  alignas(64) float window_[kWindowSide * kWindowPitch];
};

}  // namespace ktgp_orb::alignment
