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

/// How a homography is fitted.
struct EvidenceOptions {
  double max_error = 3.0;   ///< pairs within twice this error take part, px, > 0
  double min_scale = 1e-4;  ///< least scale of the errors (see HomographyFit), px, > 0
  PointErrors errors{};
  /// Pairs that are close together count like one: a part of the scene with many pairs, which may
  /// not be quite in the plane of the rest, does not decide alone.
  bool by_cell = false;
};

/// For points from the alignment of patches. `max_error`: inlier threshold of keypoints in an image
/// of 640x480 px, px. It, and the least scale (a third of it), grow in proportion to the diagonal.
EvidenceOptions evidenceOfPatches(double max_error, const cv::Size& reference_size);

/// Estimates a homography again from points that have become more accurate, or more. Starts at the
/// given one, without sampling. Keeps its buffers.
class HomographyRefiner {
 public:
  /// All in pixels; points and homography finite. True: `estimate` was refined, H(2,2) = 1. False:
  /// `estimate` is unchanged, since too few pairs are near, these do not determine it, or it is not
  /// the view of a plane from one side. `reference_size` may be empty (see imageCorners). Throws
  /// std::invalid_argument for arrays of different length.
  bool refine(const std::vector<Eigen::Vector2d>& reference,
              const std::vector<Eigen::Vector2d>& target, const cv::Size& reference_size,
              const EvidenceOptions& options, UncertainHomography& estimate);

 private:
  NormalisedPairs pairs_;
  HomographyFit fit_;
};

/// The results derived from a homography.
struct FinalHomography {
  bool trusted =
      false;  ///< it shows a plane from one side, and chance does not explain its support
  std::vector<std::uint8_t>
      mask;                 ///< one per pair: 1 where its reprojection error is below the limit
  std::size_t inliers = 0;  ///< ones in `mask`
  double rmse = 0.0;        ///< root mean square reprojection error of the inliers, px
};

/// The only place where mask, inliers, RMSE and verdict are derived from a homography, whether
/// PROSAC, guided matching or alignment found it. Keeps its buffers.
class Finaliser {
 public:
  /// `pairs`: the matches that the homography is compared with; `max_error`: inliers have less, in
  /// px or in multiples of their noise.
  void finalise(const UncertainHomography& estimate, const PointPairs& pairs,
                const cv::Size& reference_size, double max_error, FinalHomography& result);

 private:
  ContrarioTest contrario_;
  std::vector<double> squared_error_;  // px², one a pair
};

}  // namespace ktgp_orb::homography
