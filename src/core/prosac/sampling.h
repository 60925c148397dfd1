#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/util/random.h"

namespace ktgp_orb::prosac {

/// The order in which PROSAC draws: best quality first. Keeps its buffers.
class QualityOrder {
 public:
  /// Smaller is better. Equal qualities stay in the order of the input.
  void sort(const std::vector<double>& quality);

  /// The index in the input of the pair at `place` in the order.
  std::size_t operator[](std::size_t place) const { return keys_[place] & kIndexMask; }
  std::size_t size() const { return keys_.size(); }

 private:
  static constexpr int kIndexBits = 32;
  static constexpr std::uint64_t kIndexMask = 0xffffffffU;

  std::vector<std::uint64_t> keys_;  // quality in the upper half, index in the lower
  std::vector<std::uint64_t> sorted_;
};

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

/// When PROSAC may stop (Chum & Matas, CVPR 2005, section 2.2). Two rules apply to the inliers I_n
/// among the best n pairs, for every n:
/// - non-randomness (Eq. 8, 9): a wrong model has I_n inliers by chance, each further pair with
///   probability beta, less than psi = 5 % of the time;
/// - maximality (Eq. 11, 12): after k_n = log(eta0) / log(1 - P_n) samples, with P_n the chance of
///   an all-inlier sample, a better model in the best n has been missed with probability eta0.
/// The termination length n* is the n with the smallest k_n among those that pass the first rule.
class ProsacStopping {
 public:
  /// `sample_size` m: pairs that determine a model; `points` N >= m; `chance_inlier` beta in (0,
  /// 1): chance that a wrong model agrees with a pair; `confidence` 1 - eta0 in (0, 1).
  void reset(std::size_t sample_size, std::size_t points, double chance_inlier, double confidence);

  /// Updates the rules with a new best model; `inlier` is in order of quality.
  void update(const std::vector<std::uint8_t>& inlier);

  /// n*; initially N.
  std::size_t terminationLength() const { return termination_length_; }
  /// Samples until maximality is reached; infinite before non-randomness is.
  double samplesNeeded() const { return samples_needed_; }
  /// The least I_n that is not random.
  std::size_t minInliers(std::size_t n) const { return min_inliers_[n]; }

 private:
  std::size_t sample_size_ = 0;
  double log_eta_ = 0.0;
  std::size_t termination_length_ = 0;
  double samples_needed_ = 0.0;
  std::vector<std::size_t> min_inliers_;
};

}  // namespace ktgp_orb::prosac
