#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::two_view {

/// The number of false alarms of any model (homography::FalseAlarms), with repeated keypoints
/// counted once. Keeps its buffers.
class Support {
 public:
  /// Pairs within `apart` px of each other, in either image, count once.
  void load(const PointPairs& pairs, double apart);

  /// log10 of the least number of false alarms over all numbers of pairs; 0 at most. `chance`: for
  /// each pair, the chance to agree with a wrong model as well as it does; above 1 it does not
  /// agree at all. `sample`: pairs that determine a model; `models`: most models of a sample.
  double logFalseAlarms(const std::vector<double>& chance, std::size_t sample, double models);

 private:
  std::vector<std::uint32_t> reference_cell_;
  std::vector<std::uint32_t> target_cell_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint8_t> reference_taken_;
  std::vector<std::uint8_t> target_taken_;
};

}  // namespace ktgp_orb::two_view
