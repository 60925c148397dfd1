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
  /// If false, GuidedMatcher finds nothing; guided matching is not in the paper.
  bool enabled = false;
  double radius = 5.0;    ///< largest distance from the position that H predicts, px, 0.1..100
  int max_distance = 90;  ///< largest Hamming distance of the descriptors, 0..256
};

/// Matches keypoints again near the positions that a homography predicts. This finds more matches,
/// because the right keypoint must have the nearest descriptor only among the few keypoints within
/// the radius, not in the whole frame. The time is linear in the number of keypoints. Positions are
/// compared in single precision.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class GuidedMatcher {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit GuidedMatcher(const GuidedOptions& options = {});
  ~GuidedMatcher();
  GuidedMatcher(GuidedMatcher&&) noexcept;
  GuidedMatcher& operator=(GuidedMatcher&&) noexcept;

  const GuidedOptions& options() const;

  /// `homography`: reference to target, px. `matches` is set to the mutual nearest pairs within the
  /// radius, in target order, with Level::guided. If distances are equal, the keypoint with the
  /// lower index counts as nearest. `second_distance`: distance to the second nearest descriptor
  /// within the radius, or 256 if there is none. Throws std::invalid_argument for malformed
  /// features, two kinds of descriptors, and more than 4 194 304 keypoints in a frame.
  void match(const Features& reference, const Features& target, const Eigen::Matrix3d& homography,
             std::vector<Correspondence>& matches);

  /// Runs one round of guided matching after a homography was found: matches as match() does, then
  /// estimates the homography again from all these matches. The new estimate replaces `estimate`,
  /// and the function returns true, if the new estimate meets two conditions. First, at least as
  /// many matches as for the old estimate (or half as many if `by_cell` is true) are within
  /// `threshold` px of the predicted positions. Second, its horizon does not cross the reference
  /// image, unless the horizon of the old estimate does so, too. If `by_cell` is true, matches that
  /// are close together count as one match in the estimate. Without this, the part of the scene
  /// with the most matches would determine the estimate alone, and this part may be slightly off
  /// the plane of the rest. `matches`: all matches found, including those that disagree with the
  /// estimate, but without things that stand still in the image while the scene moves, such as hot
  /// pixels.
  bool refine(const Features& reference, const Features& target, double threshold, bool by_cell,
              UncertainHomography& estimate, std::vector<Correspondence>& matches);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
