#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace ktgp_orb::estimation {

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

/// Chance that a pair agrees with a wrong model: a random target point within `distance` px.
/// At least 1 %, since keypoints are not spread evenly, and at most one half.
double chanceInlier(double covered_area, double distance);

}  // namespace ktgp_orb::estimation
