#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// Number of false alarms of a-contrario detection (Moisan & Stival, IJCV 2004). Of N pairs, sets
/// of k can be chosen in C(N, k) ways and each has C(k, m) samples of m; a model through a sample
/// agrees with the other k - m of a set by chance with probability p^(k-m). So the expected number
/// of models with such support in data without any is at most
///
///   NFA(k) = (N - m) C(N, k) C(k, m) p^(k-m).
class FalseAlarms {
 public:
  /// `sample_size` m; `pairs` N.
  FalseAlarms(std::size_t sample_size, std::size_t pairs);

  /// log10 NFA of one pair more than the last time, m + 1 the first; `p`: chance that a pair agrees
  /// as well as the worst of them.
  double next(double p);

 private:
  double m_;
  double n_;
  double k_;
  double log_subsets_ = 0.0;  // log10 of (N - m) C(N, k) C(k, m)
};

/// Area in px² that the points cover: their bounding box without those that lie far out (Tukey,
/// 1977: more than three interquartile ranges beyond the quartiles, in either direction). With a
/// single wild point in the box, every agreement of the others would look like more than chance.
double coveredArea(const std::vector<Eigen::Vector2d>& points);

/// Chance that a pair agrees with a wrong homography: a random target point within `distance` px.
/// Never below 1 %, as keypoints are not spread evenly, and never above one half.
double chanceInlier(double covered_area, double distance);

/// Says whether the inliers of a homography are more than chance gives: they are when NFA(k) < 1e-4
/// for some k. A target point thrown at random into the area A that the target points cover agrees
/// within e with probability p = pi e² / A; e is never taken below 1/sqrt(pi) px.
///
/// An inlier counts only when it is farther than the threshold, in both images, from all inliers
/// that were counted before. Repeated keypoints, many-to-one matches and a corner that was found in
/// several octaves so support a homography once. Four pairs therefore never suffice; five do when
/// they are exact, and six of eight at 3 px. Keeps its buffers.
class ContrarioTest {
 public:
  /// `squared_error`: reprojection errors in px², one a pair; `covered_area`: of the target points.
  bool explainableByChance(const PointPairs& pairs, const std::vector<std::uint8_t>& mask,
                           const std::vector<double>& squared_error, double threshold,
                           double covered_area);

 private:
  bool explainable(const PointPairs& pairs, const std::vector<double>& squared_error,
                   double threshold, double covered_area);

  std::vector<std::size_t> inliers_;
  std::vector<std::size_t> counted_;  // inliers that count
};

}  // namespace ktgp_orb::homography
