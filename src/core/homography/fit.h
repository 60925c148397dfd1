#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "core/homography/m_estimator.h"
#include "core/homography/point_pairs.h"
#include "core/homography/smooth_field.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// What became of a fit.
enum class FitOutcome : std::uint8_t {
  fitted,
  unsupported,   ///< within reach there are no more pairs than a sample has
  undetermined,  ///< those there are do not say what H is
};

/// The homography of greatest likelihood (core/homography/m_estimator.h) over all pairs that it may
/// explain, and how uncertain it is. Keeps its buffers.
class HomographyFit {
 public:
  using Matrix8 = MEstimator::Matrix8;

  /// Refines H, between normalised coordinates, over the pairs within twice the threshold of it,
  /// until these stay the same. `min_scale`: floor under the scale of the errors, px. With a floor
  /// well above the errors of exact points the fit treats all points alike where no plane explains
  /// them to the last hundredth; without, it locks onto those that happen to lie in one plane.
  FitOutcome fit(const NormalisedPairs& pairs, double min_scale, Eigen::Matrix3d& homography);

  /// True where the pairs of the last fit say where the image goes, and still do without any
  /// quarter of them. `corners`: of the reference image, normalised.
  bool isDetermined(const NormalisedPairs& pairs, const Eigen::Matrix3d& homography,
                    const std::array<Eigen::Vector2d, 4>& corners) const;

  /// The homography of the last fit in pixels and how uncertain it is. `homography`: what it gave,
  /// between normalised coordinates; `corners`: of the reference image, px; `of_patches`: the pairs
  /// come from the alignment of patches, which share noise where they overlap.
  UncertainHomography inPixels(const NormalisedPairs& pairs, const Eigen::Matrix3d& homography,
                               const std::array<Eigen::Vector2d, 4>& corners, bool of_patches);

 private:
  MEstimator estimator_;
  SmoothField field_;
  std::vector<std::uint8_t> near_;  // pairs within reach
  std::vector<std::uint8_t> used_;  // those that it was last refined over
};

}  // namespace ktgp_orb::homography
