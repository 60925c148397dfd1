#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

/// Figures of merit of matches and homographies.
namespace ktgp_orb::evaluation {

/// A match is correct when it is at most so far from the truth, px.
constexpr double kCorrectWithin = 3.0;

/// Mean and root mean square of a set of values. Of no values both are 0: look at `count`.
struct ErrorSummary {
  std::size_t count = 0;
  double mean = 0.0;
  double rms = 0.0;
};

ErrorSummary summarize(const std::vector<double>& values);

/// The value in the middle; of an even number the mean of the two there; 0 of none.
double median(std::vector<double> values);

/// Hamming distance d1 over the correspondences that reached at least `level`. These are the
/// figures that the paper's tables print as "ME" and "RMSE (pixels)".
ErrorSummary descriptorDistance(const std::vector<Correspondence>& correspondences,
                                Level level = Level::knn);

/// How far matched keypoints lie apart in image coordinates, px: Eq. 10 and 11 taken literally.
/// It measures the camera's motion, not an error.
ErrorSummary displacement(const Features& reference, const Features& target,
                          const std::vector<Correspondence>& matches);

/// Retention Q: correspondences left by the ratio filter over those before it; 0 of none.
double retention(std::size_t kept, std::size_t total);

/// REP (Eq. 9): matched keypoints over detected keypoints, both counted in both images; 0 of none.
double matchedShare(std::size_t matches, const Features& reference, const Features& target);

/// x' ~ H x in pixels; infinite coordinates where H sends x to the horizon or behind it. H may have
/// any scale and sign, and its origin may lie behind the horizon; a mirrored view (det H < 0 where
/// the plane is seen) is known only of an affine H.
Eigen::Vector2d project(const Eigen::Matrix3d& homography, const Eigen::Vector2d& x);

/// Distance in the target image, px, between every match's target keypoint and the place where
/// `homography` (reference to target) puts its reference keypoint. One value per match, in order.
std::vector<double> reprojectionErrors(const Eigen::Matrix3d& homography, const Features& reference,
                                       const Features& target,
                                       const std::vector<Correspondence>& matches);

/// Number of errors of at most `threshold` px: the correct matches.
std::size_t countWithin(const std::vector<double>& errors, double threshold);

/// Precision: share of errors of at most `threshold` px; 0 of none.
double precision(const std::vector<double>& errors, double threshold);

/// Mean distance, px, between the places where the two homographies put the corners of an image
/// of `reference_size`; infinite where one of them is the zero matrix or sends a corner to
/// infinity.
double cornerError(const Eigen::Matrix3d& estimated, const Eigen::Matrix3d& truth,
                   const cv::Size& reference_size);

/// Area under the curve "share of pairs with a corner error of at most x" for x from 0 to
/// `threshold`, over `threshold`: 1 when every error is zero. An infinite error is a failed pair.
/// By the literature's rule, that of SuperGlue's pose_auc (Sarlin et al., CVPR 2020) and LoFTR: the
/// sorted errors are joined by straight lines from (0, 0) on, level behind the last below
/// `threshold`. The steps themselves enclose up to half a pair less of n, 3.3 % of 15.
double areaUnderCurve(const std::vector<double>& errors, double threshold);

/// Counts of Mikolajczyk's repeatability.
struct Repeatability {
  std::size_t reference_common = 0;  ///< reference keypoints that the target image also shows
  std::size_t target_common = 0;     ///< target keypoints that the reference image also shows
  std::size_t repeated = 0;          ///< pairs of them, one to one, whose regions overlap enough

  /// repeated over the smaller of the other two; 0 where there is none.
  double score() const;
};

/// How many keypoints the detector finds again, whatever their descriptors (Mikolajczyk et al.,
/// "A comparison of affine region detectors", IJCV 2005). A keypoint's region is the disc of its
/// size; two regions repeat when 1 - intersection/union, after scaling both so that the reference
/// region has a radius of 30 px in the target image, is at most `max_overlap_error`. `truth` maps
/// reference to target. Keypoints closer in overlap are paired first.
Repeatability detectorRepeatability(const Features& reference, const Features& target,
                                    const Eigen::Matrix3d& truth, double max_overlap_error = 0.4);

}  // namespace ktgp_orb::evaluation
