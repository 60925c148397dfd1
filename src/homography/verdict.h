#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// Number of false alarms of a-contrario detection (Moisan & Stival, IJCV 2004). Of N pairs there
/// are C(N, k) sets of k, each with C(k, m) samples of m. The other k - m pairs of a set agree with
/// the model of a sample by chance with probability p^(k-m). So the expected number of models with
/// such support by chance is at most
///
///   NFA(k) = (N - m) C(N, k) C(k, m) p^(k-m).
class FalseAlarms {
 public:
  /// `sample_size` m; `pairs` N.
  FalseAlarms(std::size_t sample_size, std::size_t pairs);

  /// log10 NFA after adding one pair, beginning with pair m + 1; `p`: chance that a pair agrees as
  /// well as the worst one so far.
  double next(double p);

 private:
  double m_;
  double n_;
  double k_;
  double log_subsets_ = 0.0;  // log10 of (N - m) C(N, k) C(k, m)
};

/// Area in px² that the points cover: their bounding box without far outliers (Tukey, 1977: more
/// than three interquartile ranges beyond the quartiles). A single outlier would enlarge the box
/// and make every agreement seem significant.
double coveredArea(const std::vector<Eigen::Vector2d>& points);

/// Chance that a pair agrees with a wrong homography: a random target point within `distance` px.
/// At least 1 %, since keypoints are not spread evenly, and at most one half.
double chanceInlier(double covered_area, double distance);

/// The verdict on a homography, whether PROSAC or the growth found it: it is trusted if it shows
/// its inliers from one side and chance does not explain them. Chance does not when NFA(k) < 1e-4
/// for some k; 1e-12 where the horizon crosses the reference, as in the picture of a street. A random target point in the area A of the target points agrees within e with
/// probability p = pi e² / A; e is at least 1/sqrt(pi) px.
///
/// An inlier counts only when it is farther than the threshold, in both images, from all inliers
/// counted before. So repeated keypoints, many-to-one matches and a corner found in several octaves
/// support a homography once. Four pairs are never enough; five are when they are exact, and six of
/// eight at 3 px. Keeps its buffers.
class HomographyVerdict {
 public:
  /// `pairs`: the matches that the homography, in px, is compared with; `threshold`: inliers have a
  /// smaller reprojection error, px. `reference_size` may be empty (see imageCorners).
  bool trusts(const Eigen::Matrix3d& homography, const PointPairs& pairs,
              const cv::Size& reference_size, double threshold);

 private:
  bool explainableByChance(const PointPairs& pairs, double threshold, double log_limit);
  bool explainable(const PointPairs& pairs, double threshold, double covered_area,
                   double log_limit);

  std::vector<double> squared_error_;  // of all pairs, px²
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
