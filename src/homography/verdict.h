#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// The verdict on a homography, whether PROSAC or the growth found it: it is trusted if it shows
/// its inliers from one side and chance does not explain them. Chance is excluded when NFA(k) <
/// 1e-4 for some k; 1e-12 where the horizon crosses the reference, as in the picture of a street. A
/// random target point in the area A of the target points agrees within e with probability p = pi
/// e² / A; e is at least 1/sqrt(pi) px.
///
/// An inlier counts only when it is farther than the threshold, in both images, from all inliers
/// counted before. So repeated keypoints, many-to-one matches and a corner found in several octaves
/// support a homography once. Four pairs are never enough; five are when they are exact, and six of
/// eight at 3 px. Keeps its buffers.
class HomographyVerdict {
 public:
  /// `pairs`: the matches that the homography, in px, is compared with; `threshold`: inliers have a
  /// smaller reprojection error, px. `reference_size` may be empty (see imageCorners).
  /// Labels `result` with the homography (see label) in any case, since that needs the same errors.
  bool trusts(const UncertainHomography& answer, const PointPairs& pairs,
              const cv::Size& reference_size, double threshold, ProsacResult& result);

 private:
  bool explainableByChance(const PointPairs& pairs, double threshold, double log_limit);
  bool explainable(const PointPairs& pairs, double threshold, double covered_area,
                   double log_limit);

  std::vector<double> squared_error_;  // squared error of the inliers, px²; one entry for each pair
  std::vector<std::size_t> inliers_;
  std::vector<std::size_t> counted_;  // inliers that count
};

/// Throws std::invalid_argument for arrays of different length and for values that are not finite.
void requireFinite(const PointPairs& pairs);

/// Sets answer, mask, inliers and RMSE of `result` from a homography, whether PROSAC, the growth or
/// a search for a target found it: the only place that does. `max_error`: inliers have less, px.
void label(const UncertainHomography& answer, const PointPairs& pairs, double max_error,
           ProsacResult& result);

}  // namespace ktgp_orb::homography
