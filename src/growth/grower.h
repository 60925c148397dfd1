#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <vector>

#include "growth/local_matcher.h"
#include "growth/reference_frames.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::growth {

/// The rounds of a growth: from round to round, the region of the reference becomes larger and the
/// search radius smaller.
struct GrowthPlan {
  int rounds;
  double first_reach;   ///< radius of the region around the seed in round 0, px of the reference
  double reach_factor;  ///< factor by which the region's radius grows each round
  float first_radius;   ///< search radius around the predicted positions in round 0, px
  /// Factor by which the search radius shrinks each round, down to Grower::kLastRadius.
  float radius_factor;
  /// The rounds end early if the search radius is at most this value, px, and the whole reference
  /// is within reach.
  float enough_radius;
  /// Search radius with which Grower::settle begins after the rounds, px; it halves the radius
  /// after each search. The searches cover the whole reference. Predictions may be off by this
  /// radius where the reference is beyond the region that the rounds reached.
  float settle_radius;
  /// Maximum number of refits at the last radius; they go on while the number of matches increases.
  int last_rounds;
  std::size_t fewest_pairs;  ///< minimum number of pairs that a round must find
  /// Minimum number of pairs with an error below the last radius: `first_exact` in round 0, and
  /// `more_exact` more in each further round, up to `most_exact`. A right seed finds several times
  /// as many. A wrong seed seldom finds enough pairs in two rounds, so it is dropped early; this
  /// matters because nearly all of the time goes into wrong seeds.
  std::size_t first_exact, more_exact, most_exact;
};

/// Plan for frames of the same scene. Such frames have so many matches that the matches alone show
/// whether a map is right. 0.863413 is (4 / 15)^(1/9): round 10 searches within 4 px.
constexpr GrowthPlan kScenePlan{10, 120.0, 4.0 / 3.0, 15.F, 0.863413F, 0.F, 4.F, 4, 1, 4, 2, 12};
/// Plan for a flat target, which may be small and have few matches. Whether a map is right is
/// decided later, by a comparison of the images.
constexpr GrowthPlan kTargetPlan{7, 90.0, 1.4, 16.F, 0.83F, 10.F, 16.F, 1, 8, 3, 1, 8};

/// Grows a map from a seed (Ferrari, Tuytelaars & Van Gool, ECCV 2004, expand and contract). Each
/// round uses the map to match in a region around the seed, fits the map again, enlarges the region
/// and reduces the search radius. Reuses its buffers from call to call.
class Grower {
 public:
  explicit Grower(const GrowthPlan& plan) : plan_(plan) {}

  static constexpr float kLastRadius = 4.F;  ///< px
  static constexpr double kEverywhere = std::numeric_limits<float>::max();

  /// Grows from the seed at `centre`, px of the reference. Returns false if a round finds too few
  /// matches. `map`: the initial guess, which is replaced by the result.
  bool grow(const Eigen::Vector2d& centre, ReferenceFrames& reference, LocalMatcher& matcher,
            Eigen::Matrix3d& map);

  /// Does the last rounds of grow(); call it directly for a homography that was not grown. Matches
  /// in the whole image and fits the homography again, first with the search radius `radius`, px,
  /// then with smaller radii. `centre`: a point of the reference near which the homography is
  /// right.
  bool settle(const Eigen::Vector2d& centre, float radius, ReferenceFrames& reference,
              LocalMatcher& matcher, Eigen::Matrix3d& map);

  /// Matches the keypoints of the reference that are within `reach` px of `centre` to target
  /// keypoints within `radius` px of the positions that `map` predicts. Returns false if there are
  /// too few matches.
  bool search(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre, double reach, float radius,
              ReferenceFrames& reference, LocalMatcher& matcher);

  /// The predictions of the last search, and the matches found near them.
  const std::vector<Prediction>& predictions() const { return predictions_; }
  const std::vector<LocalMatch>& matches() const { return matches_; }
  const PointPairs& pairs() const {
    return pairs_;
  }  ///< pairs of the matches; their quality is the share of descriptor bits that differ

 private:
  std::size_t exactPairs() const;

  const GrowthPlan& plan_;
  std::vector<Prediction> predictions_;
  std::vector<LocalMatch> matches_;
  PointPairs pairs_;
};

/// Fits a homography, or an affine map if the pairs do not determine a homography. A pair weighs
/// less if its error under the old `map` is large compared with `radius`, px. Returns false, with
/// `map` unchanged, if the pairs do not even determine an affine map.
bool refit(const PointPairs& pairs, float radius, Eigen::Matrix3d& map);

}  // namespace ktgp_orb::growth
