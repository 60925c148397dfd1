#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/util/random.h"

namespace ktgp_orb::homography {

/// Places of different pairs in the order of quality, as many as determine a model.
using ProsacSample = std::vector<std::size_t>;

/// Fills sample[first…] with numbers below `end` that the sample does not hold yet. `end` is at
/// least the sample's size.
void drawDistinct(std::size_t end, std::size_t first, util::Random& random, ProsacSample& sample);

/// Draws samples of m pairs from a growing set of the best (Chum & Matas, CVPR 2005, section 2).
///
/// The growth function says how many samples have been drawn by the time the best n pairs were
/// all sampled from. The paper's is T_N C(n,m)/C(N,m), each step rounded up to at least one sample;
/// with T_N samples in all that never gets to the end, as N - m steps are forced on top. Here
///
///   T'(n) = 1 + r (n - m) + T_N C(n,m)/C(N,m),   r = min(1, budget / 4N),   T'(N) = budget:
///
/// a steady start of r samples for each new pair, with at most a quarter of the budget, and the
/// paper's growth with what is left of it as T_N. The last pair is reached with the last sample,
/// whatever N.
class ProsacSampler {
 public:
  /// `sample_size` m >= 1; `points` N >= m; `budget`: samples that will be drawn at most, >= 1.
  ProsacSampler(std::size_t sample_size, std::size_t points, int budget, std::uint64_t seed);

  /// Takes that many samples, drawn elsewhere, off the budget. The growth keeps pace, so that the
  /// last pair is still reached with the last sample.
  void spend(int samples) { spent_ += samples; }

  /// The next sample, of m places. The set of pairs grows no further than `limit`, n* of the paper.
  void draw(std::size_t limit, ProsacSample& sample);

  int drawn() const { return drawn_; }
  /// What is left of the budget.
  int left() const { return budget_ - spent_ - drawn_; }
  std::size_t growthSetSize() const { return growth_set_size_; }

  /// T'(n), for m <= n <= N.
  double samplesUntil(std::size_t n) const;

 private:
  double orderedSamples(std::size_t n) const;

  std::size_t sample_size_;
  std::size_t points_;
  int budget_;
  double steady_;  // r
  double growth_;  // T_N over the ordered samples from N
  int drawn_ = 0;
  int spent_ = 0;
  std::size_t growth_set_size_;
  util::Random random_;
};

}  // namespace ktgp_orb::homography
