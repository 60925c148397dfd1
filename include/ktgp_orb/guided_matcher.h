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
/// not be the nearest of the whole frame, only of the few within the radius. Time is linear in the
/// keypoints. Distances between positions are computed in single precision.
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
  /// radius, in target order, with Level::guided; for equal distances the lower index is nearest.
  /// `second_distance` is the distance to the next reference keypoint within the radius, or 256.
  void match(const Features& reference, const Features& target, const Eigen::Matrix3d& homography,
             std::vector<Correspondence>& matches);

  /// One round after a homography was found: matches as above and estimates again from all these
  /// matches. The new estimate replaces `estimate` only when at least as many matches agree with it
  /// (`threshold`, px; half as many with `by_cell`) and it can be the view of a plane; returns
  /// whether. `by_cell`: matches that are close together count like one in the estimate, so that
  /// the part of the scene with most matches, which may not be quite in the plane of the rest, does
  /// not decide alone. `matches`: all matches found, also those that disagree with the estimate.
  bool refine(const Features& reference, const Features& target, double threshold, bool by_cell,
              UncertainHomography& estimate, std::vector<Correspondence>& matches);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
