#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/util/random.h"

namespace ktgp_orb {

/// Places of four different pairs in the order of quality.
using ProsacSample = std::array<std::size_t, 4>;

/// Fills sample[first..3] with numbers below `end` that the sample does not hold yet.
void drawDistinct(std::size_t end, std::size_t first, Random& random, ProsacSample& sample);

/// Draws samples of four from a growing set of the best pairs (Chum & Matas, CVPR 2005, section 2).
///
/// The growth function says how many samples have been drawn by the time the best n pairs were
/// all sampled from. The paper's is T_N C(n,4)/C(N,4), each step rounded up to at least one sample;
/// with T_N samples in all that never gets to the end, as N - 4 steps are forced on top. Here
///
///   T'(n) = 1 + r (n - 4) + T_N C(n,4)/C(N,4),   r = min(1, budget / 4N),   T'(N) = budget:
///
/// a steady start of r samples for each new pair, and the paper's growth with what is left of
/// the budget as T_N. The last pair is reached with the last sample, whatever N.
class ProsacSampler {
 public:
  /// `points` N >= 4; `budget`: samples that will be drawn at most, >= 1.
  ProsacSampler(std::size_t points, int budget, std::uint64_t seed);

  /// The next sample. The set of pairs grows no further than `limit`, n* of the paper.
  ProsacSample draw(std::size_t limit);

  int drawn() const { return drawn_; }
  std::size_t growthSetSize() const { return growth_set_size_; }

  /// T'(n), for 4 <= n <= N.
  double samplesUntil(std::size_t n) const;

 private:
  std::size_t points_;
  double steady_;  // r
  double growth_;  // T_N / (N (N-1) (N-2) (N-3))
  int drawn_ = 0;
  std::size_t growth_set_size_ = 4;
  Random random_;
};

}  // namespace ktgp_orb
