#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace ktgp_orb {

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

/// Says whether the inliers of a model are more than chance would give: they are when NFA(k) < 1e-4
/// for some k. Only pairs that stand apart from all those taken before count, as others follow from
/// them. Keeps its buffers.
class ProsacVerdict {
 public:
  /// `inliers`: of `pairs` pairs, in any order, which is lost; `error[i]`: of pair i, in any unit;
  /// `chance(e)`: probability that a random pair has an error of at most e, growing with e;
  /// `apart(i, j)`: whether pairs i and j say something independent of each other.
  template <typename Chance, typename Apart>
  bool explainableByChance(std::size_t sample_size, std::size_t pairs,
                           const std::vector<double>& error, std::vector<std::size_t>& inliers,
                           const Chance& chance, const Apart& apart);

 private:
  template <typename Chance, typename Apart>
  bool explainable(FalseAlarms false_alarms, std::size_t sample_size,
                   const std::vector<double>& error, const std::vector<std::size_t>& inliers,
                   const Chance& chance, const Apart& apart);

  std::vector<std::size_t> taken_;  // inliers that count
};

template <typename Chance, typename Apart>
bool ProsacVerdict::explainableByChance(std::size_t sample_size, std::size_t pairs,
                                        const std::vector<double>& error,
                                        std::vector<std::size_t>& inliers, const Chance& chance,
                                        const Apart& apart) {
  const FalseAlarms false_alarms(sample_size, pairs);
  // Any order gives a valid bound, the largest error so far being that of the last one taken. Good
  // models pass as they come, after a few inliers; only poor ones are worth sorting.
  if (!explainable(false_alarms, sample_size, error, inliers, chance, apart)) return false;
  std::sort(inliers.begin(), inliers.end(), [&](std::size_t a, std::size_t b) {
    return error[a] != error[b] ? error[a] < error[b] : a < b;
  });
  return explainable(false_alarms, sample_size, error, inliers, chance, apart);
}

/// The rule on the inliers in the order that they are in.
template <typename Chance, typename Apart>
bool ProsacVerdict::explainable(FalseAlarms false_alarms, std::size_t sample_size,
                                const std::vector<double>& error,
                                const std::vector<std::size_t>& inliers, const Chance& chance,
                                const Apart& apart) {
  constexpr double kLogMaxFalseAlarms = -4.0;  // log10
  double largest = 0.0;
  taken_.clear();
  for (const std::size_t candidate : inliers) {
    const auto is_apart = [&](std::size_t other) { return apart(other, candidate); };
    if (!std::all_of(taken_.begin(), taken_.end(), is_apart)) continue;
    taken_.push_back(candidate);
    largest = std::max(largest, error[candidate]);
    if (taken_.size() <= sample_size) continue;
    if (false_alarms.next(chance(largest)) < kLogMaxFalseAlarms) return false;
  }
  return true;
}

}  // namespace ktgp_orb
