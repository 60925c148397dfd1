#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/util/random.h"

namespace ktgp_orb::homography {

/// Indices of different pairs in the order of quality; as many as determine a model.
using ProsacSample = std::vector<std::size_t>;

/// Fills sample[first…] with different numbers below `end` that are not in the sample. `end` is at
/// least the size of the sample.
void drawDistinct(std::size_t end, std::size_t first, util::Random& random, ProsacSample& sample);

/// Draws samples of m pairs from a growing set of the best (Chum & Matas, CVPR 2005, section 2).
///
/// The growth function gives the number of samples after which the best n pairs were all used. The
/// paper's is T_N C(n,m)/C(N,m), each step rounded up to at least one sample. With a total of T_N
/// samples it never reaches the end, since N - m steps are forced. Here
///
///   T'(n) = 1 + r (n - m) + T_N C(n,m)/C(N,m),   r = min(1, budget / 4N),   T'(N) = budget:
///
/// a steady start of r samples for each new pair, with at most a quarter of the budget, then the
/// paper's growth with the rest of the budget as T_N. For every N, the last sample includes the
/// last pair.
class ProsacSampler {
 public:
  /// `sample_size` m >= 1; `points` N >= m; `budget`: most samples, >= 1.
  ProsacSampler(std::size_t sample_size, std::size_t points, int budget, std::uint64_t seed);

  /// Subtracts samples that were drawn elsewhere from the budget. The growth speeds up, so that the
  /// last sample still includes the last pair.
  void spend(int samples) { spent_ += samples; }

  /// The next sample, m indices. The set of pairs does not grow beyond `limit`, n* of the paper.
  void draw(std::size_t limit, ProsacSample& sample);

  int drawn() const { return drawn_; }
  /// The rest of the budget.
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
