#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/homography/problem.h"
#include "core/homography/refinement.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// What became of a fit.
enum class FitOutcome : std::uint8_t {
  fitted,
  unsupported,   ///< within reach there are no more pairs than a sample has
  undetermined,  ///< those there are do not say what H is
};

/// The homography of greatest likelihood (core/homography/refinement.h) over all pairs that it may
/// explain, and how uncertain it is. Keeps its buffers.
class HomographyFit {
 public:
  using Matrix8 = HomographyRefinement::Matrix8;

  /// Refines H, between normalised coordinates, over the pairs within twice the problem's limit of
  /// it, until these stay the same. `min_scale`: floor under the scale of the errors, px. A floor
  /// well above the errors of exact points makes a fit that no plane explains to the last hundredth
  /// treat all points alike, instead of locking onto those that happen to lie in one plane.
  FitOutcome fit(const HomographyProblem& problem, double min_scale, Eigen::Matrix3d& homography);

  /// True where the pairs of the last fit say where the image goes, and still do without any
  /// quarter of them. `corners`: of the reference image, normalised.
  bool isDetermined(const HomographyProblem& problem, const Eigen::Matrix3d& homography,
                    const std::array<Eigen::Vector2d, 4>& corners) const;

  /// Covariance of the first eight entries of the homography in pixels, with H(2,2) = 1, after the
  /// last fit. `homography`: what it gave, between normalised coordinates.
  Covariance8 pixelCovariance(const HomographyProblem& problem,
                              const Eigen::Matrix3d& homography) const;

 private:
  HomographyRefinement refinement_;
  std::vector<std::uint8_t> near_;  // pairs within reach
  std::vector<std::uint8_t> used_;  // those that it was last refined over
};

}  // namespace ktgp_orb
