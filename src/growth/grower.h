#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <vector>

#include "growth/local_matcher.h"
#include "growth/reference_frames.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::growth {

/// The rounds of a growth: the region becomes larger and the radius smaller from round to round.
struct GrowthPlan {
  int rounds;
  double first_reach;   ///< px of the reference, around the seed
  double reach_factor;  ///< factor of the reach per round
  float first_radius;   ///< px, around the predicted positions
  float radius_factor;  ///< factor of the radius per round, down to Grower::kLastRadius
  /// The rounds end when the whole reference is within reach and the radius is at most this, px.
  float enough_radius;
  /// Radius of the first search in the whole reference after the rounds, px; later searches halve
  /// it. Predictions beyond the reach of the rounds may be off by this much.
  float settle_radius;
  int last_rounds;           ///< maximum number at the last radius, as long as matches increase
  std::size_t fewest_pairs;  ///< minimum number of pairs of a round
  /// Number of pairs within the last radius that round 0 needs, its increase per round, and its
  /// maximum. A right seed finds several times as many pairs. Wrong seeds take nearly all of the
  /// time, and seldom find as many pairs in two rounds.
  std::size_t first_exact, more_exact, most_exact;
};

/// Plan for frames of the same scene, which have so many matches that these alone decide.
constexpr GrowthPlan kScenePlan{10, 120.0, 4.0 / 3.0, 15.F, 0.863413F, 0.F, 4.F, 4, 1, 4, 2, 12};
/// Plan for a flat target, which may be small and have few matches; later the images decide.
constexpr GrowthPlan kTargetPlan{7, 90.0, 1.4, 16.F, 0.83F, 10.F, 16.F, 1, 8, 3, 1, 8};

/// Grows a map from a seed (Ferrari, Tuytelaars & Van Gool, ECCV 2004, expand and contract). Each
/// round matches in a region around the seed, guided by the map, fits the map again, enlarges the
/// region and reduces the radius. Keeps its buffers.
class Grower {
 public:
  explicit Grower(const GrowthPlan& plan) : plan_(plan) {}

  static constexpr float kLastRadius = 4.F;  ///< px
  static constexpr double kEverywhere = std::numeric_limits<float>::max();

  /// Returns false if a round finds too few matches. `map`: the initial guess, then the result.
  bool grow(const Eigen::Vector2d& centre, ReferenceFrames& reference, LocalMatcher& matcher,
            Eigen::Matrix3d& map);

  /// Runs only the last rounds, which match in the whole image and fit again, first within `radius`
  /// px, for a homography that was not grown. `centre`: a point of the reference where it is right.
  bool settle(const Eigen::Vector2d& centre, float radius, ReferenceFrames& reference,
              LocalMatcher& matcher, Eigen::Matrix3d& map);

  /// Matches within `radius` px of the positions that the map predicts, in the part of the
  /// reference within `reach` px of `centre`. Returns false if there are too few matches.
  bool search(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre, double reach, float radius,
              ReferenceFrames& reference, LocalMatcher& matcher);

  /// The predictions of the last search and their matches.
  const std::vector<Prediction>& predictions() const { return predictions_; }
  const std::vector<LocalMatch>& matches() const { return matches_; }
  const PointPairs& pairs() const {
    return pairs_;
  }  ///< pairs of the matches; quality: share of bits that differ

 private:
  std::size_t exactPairs() const;

  const GrowthPlan& plan_;
  std::vector<Prediction> predictions_;
  std::vector<LocalMatch> matches_;
  PointPairs pairs_;
};

/// Fits a homography if the pairs suffice for it, else an affine map, with weights from the errors
/// of `map` relative to `radius` px. Returns false, with `map` unchanged, if the pairs determine
/// neither.
bool refit(const PointPairs& pairs, float radius, Eigen::Matrix3d& map);

}  // namespace ktgp_orb::growth
