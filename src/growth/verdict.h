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

/// log10 of a bound on the probability that chance gives `count` or more, if its mean is `mean` and
/// its variance is `spread` >= 1 times its mean. This is Chernoff's bound for the Poisson or, if
/// `spread` is above 1, the negative binomial distribution. 0 if the count is not above the mean.
double logChance(double count, double mean, double spread);

struct Judgement {
  std::size_t matched = 0;  ///< number of cells with matches, at any distance and error
  std::size_t support = 0;  ///< number of cells at the most significant distance and error
  double by_chance = 0.0;   ///< part of the support that chance would give
  double log_false_alarms =
      0.0;  ///< log10 of the expected number of homographies that are as good by chance
};

/// Decides whether the matches of a homography are more than chance gives.
///
/// Chance is measured with decoys: the homography shifted by 20 and 45 px in 24 directions each. A
/// decoy is wrong by construction, but has the same images, descriptors, region, directions and
/// sizes. The opportunities of each decoy are counted, too (keypoints predicted within 4 px of a
/// target keypoint), so the density of the target's keypoints does not matter. Matches count once
/// per 12x12 px in either image.
///
/// In a repetitive scene another shift may fit as well. So shifts that are frequent between the
/// keypoints are tried, too, and the homography must have clearly more matches than each of them.
///
/// The homography was fitted to the matches, but the decoys were not. Any four pairs determine a
/// homography that these four support. The four may come from the M pairs within the first radius
/// and, since the homography changed from round to round, from as many others in each of the ten
/// rounds. So the number of false alarms, with s seeds and twelve limits (of the Hamming distance
/// and of the error), is
///
///   NFA = 12 s C(10 M, 4) P(at least n - 4 by chance)
class Verdict {
 public:
  static constexpr float kRadius = 4.F;  ///< px
  static constexpr double kLogMaxFalseAlarms = -6.0;

  /// `predictions`: all predictions of the homography. `first_radius`: radius of the first round,
  /// px. `longest_period`: repetitions farther apart count as other copies of the object, px.
  Judgement judge(const std::vector<Prediction>& predictions, const ReferenceFrames& reference,
                  float first_radius, int seeds, LocalMatcher& matcher,
                  float longest_period = std::numeric_limits<float>::max());

  /// The repetitions that the last homography was compared with, if it was compared with any.
  const std::vector<cv::Point2f>& repeats() const { return repeats_; }

 private:
  static constexpr std::array<int, 6> kDistances{40, 48, 56, 64, 72, LocalMatcher::kMaxDistance};
  static constexpr std::array<float, 2> kRadii{2.F, kRadius};
  static constexpr std::size_t kLevels = kDistances.size() * kRadii.size();
  using Counts = std::array<double, kLevels>;

  /// Counts the matches within each limit of error and distance, once per cell in either image.
  Counts count(const std::vector<LocalMatch>& matches, const ReferenceFrames& reference,
               const LocalMatcher& matcher);
  /// Statistics of the matches of the decoys at level k, which is a pair of limits.
  struct Chance {
    double rate;    // matches per opportunity
    double spread;  // variance over the variance of a Poisson distribution
  };
  Chance chanceAt(std::size_t k) const;
  Judgement best(const Counts& own, double own_chances, double log_tests) const;
  /// Finds repetitions of the scene, such as windows of a facade or lines of letters. These are the
  /// most frequent displacements, at most 16, from a predicted keypoint to similar target keypoints
  /// up to 120 px away. Displacements within 10 px of zero are left out.
  void findRepeats(const std::vector<Prediction>& predictions, const std::vector<Bits>& reference,
                   const LocalMatcher& matcher);
  void compareWithRepeats(const std::vector<Prediction>& predictions,
                          const ReferenceFrames& reference, float longest_period,
                          LocalMatcher& matcher);
  bool isNew(const LocalFrame& frame, std::vector<std::uint64_t>& cells);

  struct Decoy {
    double chances;
    Counts counts;
  };
  static constexpr std::size_t kDecoys = 48;
  void include(const Decoy& decoy);

  std::array<Decoy, kDecoys> decoys_;
  Counts largest_{};  // largest rates of all decoys and repeats, matches per opportunity
  std::vector<cv::Point2f> repeats_;  // px
  std::vector<int> bin_votes_;        // votes for each bin of displacements
  std::vector<cv::Point2f> bin_sums_;
  std::vector<std::size_t> bin_order_;
  std::vector<LocalMatch> matches_;
  std::vector<std::uint64_t> reference_cells_;  // hash table of cells with matches
  std::vector<std::uint64_t> target_cells_;
};

struct Grown {
  Eigen::Matrix3d map;
  Judgement judgement;
  std::vector<LocalMatch> matches;
  PointPairs pairs;                  // the pairs of `matches`
  std::vector<cv::Point2f> repeats;  // see Verdict::repeats
  bool grew_from_repeats = false;    // its repetitions were grown, too
};

/// A facade also fits itself shifted by one window, and a rose window rotated by one spoke. Such a
/// homography is not due to chance, but may be wrong. True if `rival` does not have significantly
/// fewer matches than `grown`, and more than a quarter of them show places of the target that
/// `grown` shows, but other places of the reference. `target`: size of the target. `covered`:
/// buffer.
bool contradicts(const Grown& rival, const Grown& grown, const cv::Size& target,
                 std::vector<std::uint8_t>& covered);

}  // namespace ktgp_orb::growth
