#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>

#include "ktgp_orb/lens.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/target_finder.h"

namespace ktgp_orb {

/// Computes the poses of detected targets. Corrects for lens distortion and a rolling shutter.
/// Reuses its buffers from call to call. An instance belongs to one thread at a time.
class TargetPose {
 public:
  /// `readout_time`: readout time of a rolling shutter, s, -0.2 to 0.2 (see withoutShutter).
  /// 0: global shutter; -1: not known. Throws std::invalid_argument for any other value.
  explicit TargetPose(double readout_time = -1.0);
  ~TargetPose();
  TargetPose(TargetPose&&) noexcept;
  TargetPose& operator=(TargetPose&&) noexcept;

  /// Throws like the constructor.
  void setReadoutTime(double seconds);
  double readoutTime() const;

  /// Returns the poses of a target whose width is known, as planarPoses() does. `camera`: K of an
  /// image without distortion, px. `lens`: lens of the image in which the target was found; null if
  /// the image has no distortion. `stamp`: time of this image, ns; `rows`: its height, px.
  ///
  /// With lens distortion, no homography maps a flat target to the image. Therefore the point pairs
  /// of the detection are moved to where they would be without distortion, and a homography is
  /// fitted to them. If the target was also seen in the previous image, at most 0.2 s ago, the pose
  /// refers to the time when the middle row was exposed; if the readout time is not known, only the
  /// covariance allows for it (see withoutShutter).
  /// Throws in the same cases as planarPoses() and withoutShutter().
  PlanarPoses find(const DetectedTarget& target, const Eigen::Matrix3d& camera, const Lens* lens,
                   std::int64_t stamp, int rows);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
