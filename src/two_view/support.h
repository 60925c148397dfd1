#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::two_view {

/// Squared distances of a pair from where a homography maps it, and from its epipolar line, px².
using Displacement = std::pair<double, double>;

/// The number of false alarms of any model (estimation::FalseAlarms), with repeated keypoints
/// counted once. Keeps its buffers.
class Support {
 public:
  /// Pairs within `apart` px of each other, in either image, count once.
  void load(const PointPairs& pairs, double apart);

  /// log10 of the least number of false alarms over all numbers of pairs; 0 at most. `chance`: for
  /// each pair, the chance to agree with a wrong model as well as it does; above 1 it does not
  /// agree at all. `sample`: pairs that determine a model; `models`: most models of a sample.
  double logFalseAlarms(const std::vector<double>& chance, std::size_t sample, double models);

  /// log10 of a bound for the number of false alarms of an epipole that two of n pairs determine; 0
  /// at most. Errors in random directions are as long along the line as across it: the sum T of
  /// error² - 2 across² over the other pairs has the mean 0, and is T or more with a chance below
  /// exp(-T² / sum of error⁴), since the mean of exp(s cos a) over all a is below exp(s² / 4).
  /// Pairs with an error of 0 do not count.
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
