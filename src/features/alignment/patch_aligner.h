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
  distorted,     ///< H mirrors, compresses or stretches the patch too much
  textureless,   ///< too little texture to locate the patch, in one direction or both
  unsettled,     ///< the iteration did not converge
  beyond_reach,  ///< the patch moved too far from the position that H predicts
  uncorrelated,  ///< the patch at the new position looks different
};

struct AlignedPatch {
  PatchOutcome outcome = PatchOutcome::outside;
  Eigen::Vector2d reference = Eigen::Vector2d::Zero();  ///< px, centre of the patch
  Eigen::Vector2d target = Eigen::Vector2d::Zero();     ///< px, where this centre was found
  double correlation = 0.0;                             ///< NCC², 0..1
  /// Variance of each coordinate of the position, px², caused by rounding grey values to integers.
  double rounding2 = 0.0;
};

/// Finds single patches of the reference in the target. A patch is warped by the local affine part
/// of H (as in SVO; Forster et al., ICRA 2014). Its translation is found by inverse-compositional
/// least squares (Baker & Matthews, IJCV 2004), in which differences of gain and bias between the
/// images have no effect (they are projected out).
class PatchAligner {
 public:
  explicit PatchAligner(const AlignmentKernels& kernels) : kernels_(kernels) {}

  /// Sets the grey image pyramids, level 0 first. Stores only pointers to them. Returns false if a
  /// pyramid has no image, so that nothing can be aligned.
  bool setImages(const std::vector<cv::Mat>& reference, const std::vector<cv::Mat>& target);

  /// Aligns one patch. `point`: position in the reference, px; the patch is centred between the
  /// four pixels nearest to it. `reach`: largest distance by which the patch may move, in px of the
  /// target's level; at most (kWindowSide - kPatchSide) / 2 - 2.
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
