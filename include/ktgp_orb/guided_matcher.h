#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// Options of guided matching.
struct GuidedOptions {
  bool enabled = false;   ///< false: GuidedMatcher finds nothing; not in the paper
  double radius = 5.0;    ///< largest distance from the position that H predicts, px, 0.1..100
  int max_distance = 90;  ///< largest Hamming distance of the descriptors, 0..256
};

/// Matches keypoints again near the positions that a homography predicts. The right keypoint need
/// not have the nearest descriptor in the whole frame, only among the few keypoints within the
/// radius. The time is linear in the number of keypoints. Positions are compared in single
/// precision.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class GuidedMatcher {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit GuidedMatcher(const GuidedOptions& options = {});
  ~GuidedMatcher();
  GuidedMatcher(GuidedMatcher&&) noexcept;
  GuidedMatcher& operator=(GuidedMatcher&&) noexcept;

  const GuidedOptions& options() const;

  /// `homography`: reference to target, px. `matches` becomes the mutual nearest pairs within the
  /// radius, in target order, with Level::guided. For equal distances, the lower index counts.
  /// `second_distance` is the distance to the next reference keypoint within the radius, or 256.
  void match(const Features& reference, const Features& target, const Eigen::Matrix3d& homography,
             std::vector<Correspondence>& matches);

  /// One guided round after a homography was found: matches as match() does, and estimates the
  /// homography again from all these matches. The new estimate replaces `estimate` only if at least
  /// as many matches agree with it within `threshold` px (half as many with `by_cell`), and if it
  /// shows the whole reference or the old estimate does not. Returns whether it was replaced.
  /// `by_cell`: matches that are close together count as one in the estimate. Otherwise the part of
  /// the scene with the most matches, which may be slightly off the plane of the rest, would decide
  /// alone. `matches`: all matches found, including those that disagree with the estimate.
  bool refine(const Features& reference, const Features& target, double threshold, bool by_cell,
              UncertainHomography& estimate, std::vector<Correspondence>& matches);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
