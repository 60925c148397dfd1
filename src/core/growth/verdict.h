#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "core/growth/local_matcher.h"
#include "core/growth/reference_frames.h"

namespace ktgp_orb::growth {

/// log10 of a bound on the probability of `count` or more where chance gives `mean` with `spread`
/// times the variance of a Poisson distribution, spread >= 1: Chernoff's bound for Poisson, and for
/// the negative binomial where the spread is above 1. 0 where the count is not above the mean.
double logChance(double count, double mean, double spread);

/// What the verdict is based on.
struct Judgement {
  std::size_t support = 0;
  double by_chance = 0.0;         ///< how much of it chance gives
  double log_false_alarms = 0.0;  ///< log10 of the expected number of homographies as good
};

/// Whether the matches of a homography are more than chance gives.
///
/// Chance is measured: the same homography shifted by 20 and 45 px in 24 directions each (decoys)
/// is wrong by construction, but meets the same images, descriptors, region, directions and sizes.
/// Chances that a decoy has, keypoints predicted where the target has one within 4 px, and those of
/// the homography are counted, so that it does not matter where the target has more keypoints.
/// Matches count once per 6x6 px in either image.
///
/// The homography was fitted to the matches, as no decoy was: of all pairs that it could have been
/// fitted to, M within the first radius, any four determine one, which these four then support. So
/// the number of false alarms is, with s seeds tried and three limits of the Hamming distance,
///
///   NFA = 3 s C(M, 4) P(at least n - 4 by chance)
class Verdict {
 public:
  static constexpr float kRadius = 4.F;  ///< px
  static constexpr double kLogMaxFalseAlarms = -4.0;

  /// `predictions`: all that the homography predicts. `first_radius`: what it was grown from.
  Judgement judge(const std::vector<Prediction>& predictions, const ReferenceFrames& reference,
                  float first_radius, int seeds, LocalMatcher& matcher);

 private:
  static constexpr std::array<int, 3> kDistances{48, 64, LocalMatcher::kMaxDistance};
  using Counts = std::array<double, kDistances.size()>;

  /// Matches up to each of the distances, once per cell in either image.
  Counts count(const std::vector<LocalMatch>& matches, const ReferenceFrames& reference,
               const LocalMatcher& matcher);
  bool isNew(const LocalFrame& frame, std::vector<std::uint64_t>& cells);

  std::vector<LocalMatch> matches_;
  std::vector<LocalMatch> sorted_;
  std::vector<std::uint64_t> reference_cells_;  // hash tables
  std::vector<std::uint64_t> target_cells_;
};

}  // namespace ktgp_orb::growth
