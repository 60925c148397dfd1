#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

/// Numbers that say how good matches and homographies are.
namespace ktgp_orb::metrics {

/// Largest error of a correct match, px.
constexpr double kCorrectWithin = 3.0;

/// Mean and root mean square of a list of values. Both are 0 if the list is empty, so check
/// `count`.
struct ErrorSummary {
  std::size_t count = 0;
  double mean = 0.0;
  double rms = 0.0;
};

ErrorSummary summarize(const std::vector<double>& values);

/// Median; for an even number of values, the mean of the two middle values; 0 for an empty list.
double median(std::vector<double> values);

/// Mean and RMS of the Hamming distance d1 of the correspondences that reached at least `level`.
/// The paper's tables print these figures as "ME" and "RMSE (pixels)".
ErrorSummary descriptorDistance(const std::vector<Correspondence>& correspondences,
                                Level level = Level::knn);

/// Mean and RMS of the distance between the image coordinates of matched keypoints, px (Eq. 10 and
/// 11 as the paper prints them). This measures the camera's motion, not an error.
ErrorSummary displacement(const Features& reference, const Features& target,
                          const std::vector<Correspondence>& matches);

/// Retention Q of the paper: the number `kept` by the ratio filter, divided by the `total` number
/// of correspondences; 0 if there are none.
double retention(std::size_t kept, std::size_t total);

/// REP (Eq. 9): number of matched keypoints, divided by the number of detected keypoints, both
/// summed over the two images; 0 if there are no keypoints.
double matchedShare(std::size_t matches, const Features& reference, const Features& target);

/// Maps the point `x` by `homography` (H), in px; the result is infinite if x is on or behind the
/// horizon. H may have any scale and sign, and the origin of the image may be behind the horizon. A
/// mirrored view (det H < 0 where the plane is seen) is mapped correctly only if H is affine.
Eigen::Vector2d project(const Eigen::Matrix3d& homography, const Eigen::Vector2d& x);

/// Distance in px between the target keypoint of each match and the position that `homography`
/// (reference to target) predicts. One value per match, in order.
std::vector<double> reprojectionErrors(const Eigen::Matrix3d& homography, const Features& reference,
                                       const Features& target,
                                       const std::vector<Correspondence>& matches);

/// Number of errors that are at most `threshold` px, which is the number of correct matches.
std::size_t countWithin(const std::vector<double>& errors, double threshold);

/// Precision: share of the errors that are at most `threshold` px; 0 if the list is empty.
double precision(const std::vector<double>& errors, double threshold);

/// Maps the corners of an image of `reference_size` by both homographies, and returns the mean
/// distance between the two positions of a corner, px; infinite if a homography is the zero matrix
/// or maps a corner to infinity.
double cornerError(const Eigen::Matrix3d& estimated, const Eigen::Matrix3d& truth,
                   const cv::Size& reference_size);

/// Area under the accuracy curve from 0 to `threshold` px, divided by `threshold`; it is 1 if all
/// errors are zero. The accuracy at x is the share of image pairs whose corner error is at most x
/// px. `errors`: corner error of each image pair, px; infinite if no homography was found. Uses the
/// trapezoid rule like SuperGlue's pose_auc (Sarlin et al., CVPR 2020) and LoFTR: straight lines
/// join the sorted errors, starting at (0, 0), and the curve stays level after the last error below
/// `threshold`. The area under the exact step curve is smaller by up to 1/(2 n) for n pairs (3.3 %
/// for 15 pairs).
double areaUnderCurve(const std::vector<double>& errors, double threshold);

/// Keypoint counts for Mikolajczyk's repeatability, see detectorRepeatability().
struct Repeatability {
  /// Number of reference keypoints that the target image also shows.
  std::size_t reference_common = 0;
  /// Number of target keypoints that the reference image also shows.
  std::size_t target_common = 0;
  /// Number of one-to-one pairs of these keypoints whose regions overlap enough.
  std::size_t repeated = 0;

  /// `repeated`, divided by the smaller of the other two counts; 0 if the smaller count is 0.
  double score() const;
};

/// Counts how many reference keypoints the detector finds again in the target, whatever their
/// descriptors are (Mikolajczyk et al., "A comparison of affine region detectors", IJCV 2005). The
/// region of a keypoint is a disc whose diameter is the keypoint's size. Before the comparison,
/// both regions are scaled so that the reference region has a radius of 30 px in the target image.
/// The keypoint is repeated if 1 - intersection/union of the scaled regions is at most
/// `max_overlap_error`. Each keypoint joins at most one pair; pairs with the largest overlap are
/// formed first. `truth` maps reference to target.
Repeatability detectorRepeatability(const Features& reference, const Features& target,
                                    const Eigen::Matrix3d& truth, double max_overlap_error = 0.4);

}  // namespace ktgp_orb::metrics
