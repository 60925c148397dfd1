#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace ktgp_orb::homography {

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

}  // namespace ktgp_orb::homography
