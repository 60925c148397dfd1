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
  double reach_factor;  ///< per round
  float first_radius;   ///< px, around the predicted positions
  float radius_factor;  ///< per round, down to Grower::kLastRadius
  /// The growth ends when the whole reference is within reach and the radius is below this one, px.
  float enough_radius;
  /// Radius of the first match in the whole reference after that, px; it is then halved. Parts
  /// beyond the reach of the rounds before may be off by this much.
  float settle_radius;
  int last_rounds;           ///< most rounds at the last radius, while there are more matches
  std::size_t fewest_pairs;  ///< minimum number of pairs of a round
  /// Pairs within the last radius that round 0 needs, how many more each next round needs, and the
  /// most. A right seed finds several times as many. Wrong seeds take nearly all of the time, and
  /// seldom find as many in two rounds.
  std::size_t first_exact, more_exact, most_exact;
};

/// Plan for frames of the same scene: many matches, which alone decide about the result.
constexpr GrowthPlan kScenePlan{10, 120.0, 4.0 / 3.0, 15.F, 0.863413F, 0.F, 4.F, 4, 1, 4, 2, 12};
/// Plan for a flat target, which may be small in the frame: fewer matches; the images decide later.
constexpr GrowthPlan kTargetPlan{7, 90.0, 1.4, 16.F, 0.83F, 10.F, 16.F, 1, 8, 3, 1, 8};

/// Grows a map from a seed (Ferrari, Tuytelaars & Van Gool, ECCV 2004, expand and contract): guided
/// matching in a region around it, a new fit of the map, then a larger region and a smaller radius.
/// Keeps its buffers.
class Grower {
 public:
  explicit Grower(const GrowthPlan& plan) : plan_(plan) {}

  static constexpr float kLastRadius = 4.F;  ///< px
  static constexpr double kEverywhere = std::numeric_limits<float>::max();

  /// False if too few matches are found on the way. `map`: the initial guess; then the homography.
  bool grow(const Eigen::Vector2d& centre, ReferenceFrames& reference, LocalMatcher& matcher,
            Eigen::Matrix3d& map);

  /// The last rounds alone: matches in the whole image and a new fit, first within `radius` px. For
  /// a homography from elsewhere. `centre`: a point of the reference where it holds.
  bool settle(const Eigen::Vector2d& centre, float radius, ReferenceFrames& reference,
              LocalMatcher& matcher, Eigen::Matrix3d& map);

  /// Matches within `radius` px of the positions that the map predicts, in the part of the
  /// reference within `reach` px of `centre`. False if there are too few.
  bool search(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre, double reach, float radius,
              ReferenceFrames& reference, LocalMatcher& matcher);

  /// The predictions of the last search and their matches.
  const std::vector<Prediction>& predictions() const { return predictions_; }
  const std::vector<LocalMatch>& matches() const { return matches_; }
  const PointPairs& pairs() const {
    return pairs_;
  }  ///< pairs of the matches; quality: the distance

 private:
  std::size_t exactPairs() const;

  const GrowthPlan& plan_;
  std::vector<Prediction> predictions_;
  std::vector<LocalMatch> matches_;
  PointPairs pairs_;
};

/// A homography where there are enough pairs, else an affine map; weights from the errors of `map`
/// within `radius` px. False, with `map` unchanged, if they do not determine one.
bool refit(const PointPairs& pairs, float radius, Eigen::Matrix3d& map);

}  // namespace ktgp_orb::growth
