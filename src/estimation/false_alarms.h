#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace ktgp_orb::estimation {

/// Number of false alarms (NFA) of a-contrario detection (Moisan & Stival, IJCV 2004). N pairs have
/// C(N, k) subsets of k pairs, and each subset has C(k, m) samples of m pairs. The other k - m
/// pairs of the subset agree with the model of a sample by chance with probability p^(k-m), where p
/// is the probability for one pair. So the expected number of models that k pairs support by chance
/// is at most
///
///   NFA(k) = (N - m) C(N, k) C(k, m) p^(k-m).
class FalseAlarms {
 public:
  /// `sample_size`: m. `pairs`: N.
  FalseAlarms(std::size_t sample_size, std::size_t pairs);

  /// Adds one pair and returns log10 of the NFA; the first call adds pair m + 1. `p`: probability
  /// that a random pair agrees at least as well as the worst pair so far.
  double next(double p);

 private:
  double m_;
  double n_;
  double k_;
  double log_subsets_ = 0.0;  // log10 of (N - m) C(N, k) C(k, m) for the present k
};

/// Area, px², of the bounding box of the points. Far outliers (Tukey, 1977: more than three
/// interquartile ranges beyond the quartiles) are left out, because a single outlier would enlarge
/// the box and make every agreement seem significant.
double coveredArea(const std::vector<Eigen::Vector2d>& points);

/// Probability that a pair agrees with a wrong model, because its target point lies within
/// `distance` px of the predicted point by chance. It is at least 1 %, since keypoints are not
/// spread evenly, and at most 50 %.
double chanceInlier(double covered_area, double distance);

}  // namespace ktgp_orb::estimation
