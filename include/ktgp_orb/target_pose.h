#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>

#include "ktgp_orb/lens.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/target_finder.h"

namespace ktgp_orb {

/// Poses of detected targets in front of a camera with a lens and a shutter. Keeps its buffers. An
/// instance belongs to one thread at a time.
class TargetPose {
 public:
  /// `readout_time`: of a rolling shutter, from the first row to the last one, s; 0: a global
  /// shutter; below 0: not known.
  explicit TargetPose(double readout_time = -1.0);
  ~TargetPose();
  TargetPose(TargetPose&&) noexcept;
  TargetPose& operator=(TargetPose&&) noexcept;

  void setReadoutTime(double seconds);

  /// The poses of a target with a width, as of planarPoses(). `camera`: K of an image without
  /// distortion, px. `lens`: of the image that the target was found in; null: it has no distortion.
  /// `stamp`, ns, and `rows`: of the image.
  ///
  /// With lens distortion, no homography maps a flat target to the image. Then the pairs of the
  /// detection are rectified, and a homography is fitted to them. Unless the shutter is a global
  /// one, a target that was seen in the image before has the pose that it had when the middle row
  /// was exposed (see withoutShutter). Throws as planarPoses() and withoutShutter().
  PlanarPoses find(const DetectedTarget& target, const Eigen::Matrix3d& camera, const Lens* lens,
                   std::int64_t stamp, int rows);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
