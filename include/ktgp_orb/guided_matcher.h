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
  double radius = 5.0;    ///< how far from where H puts it a keypoint may be found, px, 0.1..100
  int max_distance = 90;  ///< Hamming distance of the descriptors at most, 0..256
};

/// Matches keypoints again where a homography says that they are: among those within a few px the
/// right one need not be the nearest of the whole frame, only of these. Linear in the keypoints.
/// How near they are is computed in single precision.
///
/// An instance belongs to one thread at a time; several instances may run side by side.
class GuidedMatcher {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit GuidedMatcher(const GuidedOptions& options = {});
  ~GuidedMatcher();
  GuidedMatcher(GuidedMatcher&&) noexcept;
  GuidedMatcher& operator=(GuidedMatcher&&) noexcept;

  const GuidedOptions& options() const;

  /// `homography`: reference to target, px. `matches` become the pairs of which each is the other's
  /// nearest within the radius, in target order, of Level::guided; of equal distances the lower
  /// index is nearest. `second_distance` is that to the next of the reference's keypoints within
  /// the radius, 256 where there is none.
  void match(const Features& reference, const Features& target, const Eigen::Matrix3d& homography,
             std::vector<Correspondence>& matches);

  /// One round after a homography was found: matches as above, estimates again from all of these
  /// matches, and takes that where no fewer of them agree with it (`threshold`, px) than with the
  /// one handed in and it can be the view of a plane. `estimate` is only changed then; it returns
  /// whether. `matches`: all that were found, also those that the estimate does not agree with.
  bool refine(const Features& reference, const Features& target, double threshold,
              UncertainHomography& estimate, std::vector<Correspondence>& matches);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
