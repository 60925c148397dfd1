#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "core/homography/a_contrario.h"
#include "core/homography/fit.h"
#include "core/homography/point_pairs.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// What a homography is fitted to.
struct EvidenceOptions {
  double max_error = 3.0;   ///< pairs within twice that of the homography take part, px, > 0
  double min_scale = 1e-4;  ///< floor under the scale of the errors (see HomographyFit), px, > 0
  bool of_patches = false;  ///< the pairs come from the alignment of patches, not from keypoints
};

/// For points from the alignment of patches. `max_error`: inlier threshold of keypoints in an image
/// of 640x480 px, px; it and a third of it, the least scale, grow in proportion to the diagonal.
EvidenceOptions evidenceOfPatches(double max_error, const cv::Size& reference_size);

/// Estimates a homography anew from points that have become more exact, or more: starts at the one
/// there is and samples nothing. Keeps its buffers.
class HomographyRefiner {
 public:
  /// All in pixels; points and homography finite. True where `estimate` was refined, H(2,2) = 1.
  /// False, and `estimate` untouched, where the pairs within reach
  /// are too few or do not determine it, or where it is no view of a plane from one side.
  /// `reference_size` may be empty (see imageCorners). Throws std::invalid_argument for arrays of
  /// different length.
  bool refine(const std::vector<Eigen::Vector2d>& reference,
              const std::vector<Eigen::Vector2d>& target, const cv::Size& reference_size,
              const EvidenceOptions& options, UncertainHomography& estimate);

 private:
  NormalisedPairs pairs_;
  HomographyFit fit_;
};

/// Everything that a result says of its homography.
struct FinalHomography {
  bool trusted =
      false;  ///< it shows a plane from one side, and chance does not explain its support
  UncertainHomography estimate;
  std::vector<std::uint8_t>
      mask;                 ///< one a pair: 1 where its reprojection error is below the limit
  std::size_t inliers = 0;  ///< ones in `mask`
  double rmse = 0.0;        ///< root mean square reprojection error of the inliers, px
};

/// The one place where mask, inliers, RMSE and verdict are derived from a homography, whatever made
/// it: PROSAC, guided matching, alignment. Keeps its buffers.
class Finaliser {
 public:
  /// `pairs`: the matches that the homography is held to; `max_error`: an inlier is below that, px.
  void finalise(const UncertainHomography& estimate, const PointPairs& pairs,
                const cv::Size& reference_size, double max_error, FinalHomography& result);

 private:
  ContrarioTest contrario_;
  std::vector<double> squared_error_;  // px², one a pair
};

}  // namespace ktgp_orb::homography
