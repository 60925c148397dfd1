#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <opencv2/core/types.hpp>
#include <vector>

#include "growth/local_frame.h"
#include "growth/local_matcher.h"
#include "growth/reference_frames.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::growth {

/// log10 of an upper bound on the probability that chance gives `count` or more, if the count has
/// the given `mean`, and a variance of `spread` >= 1 times the mean. The bound is Chernoff's bound
/// for the Poisson distribution or, if `spread` is above 1, for the negative binomial distribution.
/// Returns 0 if the count is not above the mean.
double logChance(double count, double mean, double spread);

struct Judgement {
  /// Number of cells (12x12 px) with matches within the largest limits of Hamming distance and
  /// error.
  std::size_t matched = 0;
  /// Number of cells with matches at the most significant level, which is the combination of a
  /// limit of the distance and a limit of the error with the fewest expected false alarms.
  std::size_t support = 0;
  double by_chance = 0.0;  ///< the support that chance alone is expected to give
  double log_false_alarms =
      0.0;  ///< log10 of the expected number of homographies that are as good by chance
  /// The same number without the demand that no shifted copy of the homography has nearly as many
  /// matches. If only this number is low, the matches are not due to chance, but the scene repeats
  /// itself, and the matches do not show which of the shifted copies is right.
  double log_by_chance = 0.0;
};

/// Decides whether a homography has more matches than chance explains.
///
/// Chance is measured with decoys: the homography shifted by 20 and 45 px in 24 directions each. A
/// decoy is certainly wrong, but is tested in the same region of the same images, with the same
/// descriptors, directions and sizes. We also count the opportunities of each decoy, that is, the
/// keypoints that it predicts within 4 px of a target keypoint. So the density of the target's
/// keypoints does not matter. Matches count once per 12x12 px in either image.
///
/// In a repetitive scene another shift may fit as well. So we also shift the homography by the most
/// frequent displacements between similar keypoints. The homography must have clearly more matches
/// than each of these shifted copies.
///
/// Unlike the decoys, the homography was fitted to its matches: any four pairs determine a
/// homography, and then agree with it. The first round chooses among M pairs (all pairs of similar
/// keypoints within the first radius). Since the homography changes from round to round, the four
/// pairs may come from M other pairs in each of the ten rounds, so there are C(10 M, 4) ways to
/// choose them. With s seeds, n matches of the homography and twelve levels (combinations of a
/// limit of the Hamming distance and a limit of the error), the number of false alarms is
///
///   NFA = 12 s C(10 M, 4) P(at least n - 4 by chance)
class Verdict {
 public:
  static constexpr float kRadius = 4.F;  ///< px
  static constexpr double kLogMaxFalseAlarms = -6.0;

  /// Judges a homography. `predictions`: all its predictions. `first_radius`: search radius of the
  /// first round, px. `longest_period`: a frequent displacement of up to this length, px, counts as
  /// a repetition of the scene; a longer one leads to another copy of the object and is ignored.
  Judgement judge(const std::vector<Prediction>& predictions, const ReferenceFrames& reference,
                  float first_radius, int seeds, LocalMatcher& matcher,
                  float longest_period = std::numeric_limits<float>::max());

  /// The displacements, px of the target, with which the scene repeats itself, from the last call
  /// of judge() that looked for them. judge() looks for them only if the homography has clearly
  /// more matches than the decoys.
  const std::vector<cv::Point2f>& repeats() const { return repeats_; }

 private:
  static constexpr std::array<int, 6> kDistances{40, 48, 56, 64, 72, LocalMatcher::kMaxDistance};
  static constexpr std::array<float, 2> kRadii{2.F, kRadius};
  static constexpr std::size_t kLevels = kDistances.size() * kRadii.size();
  using Counts = std::array<double, kLevels>;

  /// Counts the matches within each limit of error and distance, once per cell in either image.
  Counts count(const std::vector<LocalMatch>& matches, const ReferenceFrames& reference,
               const LocalMatcher& matcher);
  /// Statistics of the decoys' matches at level k. A level is a pair of limits, one of the error
  /// and one of the Hamming distance.
  struct Chance {
    double rate;    // mean number of matches per opportunity
    double spread;  // variance, divided by the variance of a Poisson distribution
  };
  Chance chanceAt(std::size_t k) const;
  Judgement best(const Counts& own, double own_chances, double log_tests, double above) const;
  Judgement judgementOf(const Counts& own, double own_chances, double log_tests) const;
  /// Finds repetitions of the scene, such as windows of a facade or lines of letters. Repetitions
  /// are the most frequent displacements, at most 16, from a predicted keypoint to similar target
  /// keypoints up to 120 px away. Displacements of up to 10 px are left out.
  void findRepeats(const std::vector<Prediction>& predictions, const std::vector<Bits>& reference,
                   const LocalMatcher& matcher);
  void compareWithRepeats(const std::vector<Prediction>& predictions,
                          const ReferenceFrames& reference, float longest_period,
                          LocalMatcher& matcher);
  bool isNew(const LocalFrame& frame, std::vector<std::uint64_t>& cells);

  struct Decoy {
    double chances;  // number of opportunities: predictions within kRadius of a target keypoint
    Counts counts;
  };
  static constexpr std::size_t kDecoys = 48;
  void include(const Decoy& decoy);

  std::array<Decoy, kDecoys> decoys_;
  // For each level, the largest rate of all decoys and repetitions, in matches per opportunity.
  Counts largest_{};
  std::vector<cv::Point2f> repeats_;  // px
  std::vector<int> bin_votes_;        // number of votes for each bin of displacements
  std::vector<cv::Point2f> bin_sums_;
  std::vector<std::size_t> bin_order_;
  std::vector<LocalMatch> matches_;
  std::vector<std::uint64_t> reference_cells_;  // hash table of the cells that have a match
  std::vector<std::uint64_t> target_cells_;
};

struct Grown {
  Eigen::Matrix3d map;
  Judgement judgement;
  std::vector<LocalMatch> matches;
  PointPairs pairs;                  // point pairs of `matches`
  std::vector<cv::Point2f> repeats;  // see Verdict::repeats
  // True if growFromRepeats() has already tried the `repeats` of this homography.
  bool grew_from_repeats = false;
};

/// Returns the share of the matches of `rival` that agree with `grown` (error below 10 px), 0..1.
double agreement(const Grown& rival, const Grown& grown);

/// Returns true if `rival` is a serious alternative to `grown`. In a repetitive scene, a wrong
/// homography can have many matches: a facade also fits itself after a shift by one window, and a
/// rose window after a rotation by one spoke. `rival` contradicts `grown` if it does not have
/// significantly fewer matches, and if more than a quarter of its matches lie where `grown` has
/// matches in the target, but do not agree with `grown` (error of 10 px or more). `target`: size of
/// the target. `covered`: buffer.
bool contradicts(const Grown& rival, const Grown& grown, const cv::Size& target,
                 std::vector<std::uint8_t>& covered);

}  // namespace ktgp_orb::growth
