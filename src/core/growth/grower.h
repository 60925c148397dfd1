#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/growth/local_matcher.h"
#include "core/growth/map_fit.h"
#include "core/growth/reference_frames.h"

namespace ktgp_orb::growth {

/// Grows a map from a seed (Ferrari, Tuytelaars & Van Gool, ECCV 2004, expand and contract): guided
/// matching in a region around it, a new fit of the map, then a larger region and a smaller radius.
/// Keeps its buffers.
class Grower {
 public:
  static constexpr float kFirstRadius = 15.F;  ///< px
  static constexpr float kLastRadius = 4.F;

  /// False if too few matches are found on the way. `map`: the initial guess; then the homography.
  bool grow(const Eigen::Vector2d& centre, ReferenceFrames& reference, LocalMatcher& matcher,
            Eigen::Matrix3d& map);

  /// The last rounds alone: matches in the whole image and a new fit, until there are no more of
  /// them. For a homography from elsewhere. `centre`: a point of the reference where it holds.
  bool settle(const Eigen::Vector2d& centre, ReferenceFrames& reference, LocalMatcher& matcher,
              Eigen::Matrix3d& map);

  /// After grow() or settle(): the predictions of the homography over the whole image, and the
  /// matches there.
  const std::vector<Prediction>& predictions() const { return predictions_; }
  const std::vector<LocalMatch>& matches() const { return matches_; }
  const std::vector<PlacePair>& pairs() const { return pairs_; }

 private:
  bool search(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre, double reach, float radius,
              ReferenceFrames& reference, LocalMatcher& matcher);
  std::size_t exactPairs(const Eigen::Matrix3d& map) const;
  bool refit(float radius, Eigen::Matrix3d& map) const;

  std::vector<Prediction> predictions_;
  std::vector<LocalMatch> matches_;
  std::vector<PlacePair> pairs_;
};

}  // namespace ktgp_orb::growth
