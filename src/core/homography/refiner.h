#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/homography/fit.h"
#include "core/homography/problem.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

struct RefinerOptions {
  double max_error = 3.0;   ///< pairs within twice that of the homography take part, px, > 0
  double min_scale = 1e-4;  ///< floor under the scale of the errors (see HomographyFit), px, > 0
};

/// Estimates a homography anew from points that have become more exact, or more: starts at the one
/// there is and samples nothing. Keeps its buffers.
class HomographyRefiner {
 public:
  /// All in pixels; points and homography finite. True where `homography` was refined, H(2,2) = 1,
  /// and `covariance`, if not null, that of its first eight entries. False, and both untouched,
  /// where the pairs within reach are too few or do not determine it, or where it is no view of a
  /// plane from one side. Throws std::invalid_argument for arrays of different length.
  bool refine(const std::vector<Eigen::Vector2d>& reference,
              const std::vector<Eigen::Vector2d>& target, const RefinerOptions& options,
              Eigen::Matrix3d& homography, Covariance8* covariance);

 private:
  HomographyProblem problem_;
  HomographyFit fit_;
};

}  // namespace ktgp_orb
