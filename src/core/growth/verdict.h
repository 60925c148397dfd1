#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "core/growth/local_matcher.h"
#include "core/growth/reference_frames.h"
#include "core/growth/repeats.h"

namespace ktgp_orb::growth {

/// log10 of a bound on the probability of `count` or more where chance gives `mean` with `spread`
/// times the variance of a Poisson distribution, spread >= 1: Chernoff's bound for Poisson, and for
/// the negative binomial where the spread is above 1. 0 where the count is not above the mean.
double logChance(double count, double mean, double spread);

/// What the verdict is based on.
struct Judgement {
  std::size_t matched = 0;        ///< cells with matches, of whatever distance and error
  std::size_t support = 0;        ///< the same for the distance and the error that say most
  double by_chance = 0.0;         ///< how much of it chance gives
  double log_false_alarms = 0.0;  ///< log10 of the expected number of homographies as good
};

/// Whether the matches of a homography are more than chance gives.
///
/// Chance is measured: the same homography shifted by 20 and 45 px in 24 directions each (decoys)
/// is wrong by construction, but meets the same images, descriptors, region, directions and sizes.
/// Chances that a decoy has, keypoints predicted where the target has one within 4 px, and those of
/// the homography are counted, so that it does not matter where the target has more keypoints.
/// Matches count once per 12x12 px in either image.
///
/// Where the scene repeats itself, another shift may do as well: the shifts that the keypoints
/// themselves say are frequent (Repeats) are met too, and the homography must have well more
/// matches than each.
///
/// The homography was fitted to the matches, as no decoy was. Any four pairs determine one, which
/// these four then support. It could have been fitted to all M pairs within the first radius and,
/// as it moved from round to round, to as many others in each of the ten rounds. So the number of
/// false alarms is, with s seeds and
/// twelve limits (of the Hamming distance and of the error),
///
///   NFA = 12 s C(10 M, 4) P(at least n - 4 by chance)
class Verdict {
 public:
  static constexpr float kRadius = 4.F;  ///< px
  static constexpr double kLogMaxFalseAlarms = -6.0;

  /// `predictions`: all that the homography predicts. `first_radius`: what it was grown from.
  Judgement judge(const std::vector<Prediction>& predictions, const ReferenceFrames& reference,
                  float first_radius, int seeds, LocalMatcher& matcher);

  /// The shifts that the last one was held against, where it was so good that they mattered.
  const std::vector<cv::Point2f>& repeats() const { return repeats_.shifts(); }

 private:
  static constexpr std::array<int, 6> kDistances{40, 48, 56, 64, 72, LocalMatcher::kMaxDistance};
  static constexpr std::array<float, 2> kRadii{2.F, kRadius};
  static constexpr std::size_t kLevels = kDistances.size() * kRadii.size();
  using Counts = std::array<double, kLevels>;

  /// Matches within each of the radii and up to each of the distances, once per cell in either
  /// image.
  Counts count(const std::vector<LocalMatch>& matches, const ReferenceFrames& reference,
               const LocalMatcher& matcher);
  /// What the decoys say of matches up to level k.
  struct Chance {
    double rate;    // matches for each chance
    double spread;  // variance over that of a Poisson distribution
  };
  Chance chanceAt(std::size_t k) const;
  Judgement best(const Counts& own, double own_chances, double log_tests) const;
  void meetRepeats(const std::vector<Prediction>& predictions, const ReferenceFrames& reference,
                   LocalMatcher& matcher);
  bool isNew(const LocalFrame& frame, std::vector<std::uint64_t>& cells);

  struct Decoy {
    double chances;
    Counts counts;
  };
  static constexpr std::size_t kDecoys = 48;
  void raise(const Decoy& decoy);

  std::array<Decoy, kDecoys> decoys_;
  Counts largest_{};  // of all decoys and repeats, matches for each chance
  Repeats repeats_;
  std::vector<LocalMatch> matches_;
  std::vector<std::uint64_t> reference_cells_;  // hash tables
  std::vector<std::uint64_t> target_cells_;
};

}  // namespace ktgp_orb::growth
