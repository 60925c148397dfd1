#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::two_view {

/// Two squared distances of a pair's target point, px²: from the reference point that the
/// homography maps into the target (error²), and from the epipolar line (across²).
using Displacement = std::pair<double, double>;

/// Computes the number of false alarms of a model (see estimation::FalseAlarms). Pairs with a
/// keypoint at nearly the same place count once. Reuses its buffers from call to call.
class Support {
 public:
  /// Pairs with a point in the same square cell of `apart` px, in either image, count once.
  void load(const PointPairs& pairs, double apart);

  /// log10 of the number of false alarms, the lowest over all choices of how many of the best pairs
  /// count as inliers; at most 0. `chance`: for each pair, the probability that it agrees with a
  /// wrong model at least as closely as with this model; 1 or more if the pair does not agree with
  /// this model, NaN if it does not count. `sample`: number of pairs that determine a model.
  /// `models`: largest number of models of a sample.
  double logFalseAlarms(const std::vector<double>& chance, std::size_t sample, double models);

  /// log10 of an upper bound on the number of false alarms of an epipole; at most 0. Any two of the
  /// n pairs determine an epipole. If the errors of the other pairs have random directions, the
  /// mean squared error is the same along and across the epipolar line. So T, the sum of error² - 2
  /// across² over the other pairs, has the mean 0. The probability that such errors give T or more
  /// is below exp(-T² / sum of error⁴), because for every s the mean of exp(s cos a) over all
  /// angles a is below exp(s²/4). Pairs with an error of 0 do not count.
  double logParallax(const std::vector<Displacement>& pairs);

 private:
  void clear();
  bool isRepeated(std::uint32_t pair);

  std::vector<std::uint32_t> reference_cell_;
  std::vector<std::uint32_t> target_cell_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint8_t> reference_taken_;
  std::vector<std::uint8_t> target_taken_;
};

}  // namespace ktgp_orb::two_view
