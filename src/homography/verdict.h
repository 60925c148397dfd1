#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// Judges a homography that PROSAC or growth found. A homography is trusted if it shows its inliers
/// from one side and if they cannot be explained by chance. Chance is excluded if the number of
/// false alarms NFA(k) (see estimation::FalseAlarms) is below 1e-4 for some number k of inliers, or
/// below 1e-12 if the horizon crosses the reference, as in the picture of a street. If a target
/// point lay at random in the area A of the target points, its error would be at most e with the
/// probability p = pi e² / A. Here e is the largest error of the k inliers, but at least 1/sqrt(pi)
/// px.
///
/// An inlier counts only if it is farther than the threshold, in both images, from all inliers
/// counted before. So repeated keypoints, many-to-one matches and a corner found in several octaves
/// support a homography only once. Four pairs are never enough. With target points over 640x480 px,
/// five exact pairs alone are enough, and so are six of eight pairs with errors of 3 px. Reuses its
/// buffers from call to call.
class HomographyVerdict {
 public:
  /// Returns true if the homography of `answer`, in px, can be trusted. `pairs`: the matches that
  /// it is compared with; `threshold`: inliers have a smaller reprojection error, px.
  /// `reference_size` may be empty (see imageCorners). In any case, sets `result` as label() does,
  /// because both functions need the same errors.
  bool trusts(const UncertainHomography& answer, const PointPairs& pairs,
              const cv::Size& reference_size, double threshold, ProsacResult& result);

 private:
  bool explainableByChance(const PointPairs& pairs, double threshold, double log_limit);
  bool explainable(const PointPairs& pairs, double threshold, double covered_area,
                   double log_limit);

  std::vector<double> squared_error_;  // squared error of each pair, px²; set only for inliers
  std::vector<std::size_t> inliers_;
  // Indices of the inliers that count, because they are far enough from each other.
  std::vector<std::size_t> counted_;
};

/// Throws std::invalid_argument for arrays of different length and for values that are not finite.
void requireFinite(const PointPairs& pairs);

/// Sets answer, mask, inliers and RMSE of `result` from a homography. PROSAC, growth and the search
/// for targets use this function. `max_error`: inliers have a smaller error, px.
void label(const UncertainHomography& answer, const PointPairs& pairs, double max_error,
           ProsacResult& result);

}  // namespace ktgp_orb::homography
