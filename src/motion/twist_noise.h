#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "motion/camera_pose.h"

namespace ktgp_orb::motion {

/// How large the noise of a twist is, compared with its covariance.
///
/// The covariance of a homography is right for the homography. A part of its error is alike from
/// frame to frame and cancels in a velocity, and how large that part is depends on the pictures.
/// But over six frames a camera moves smoothly, and noise does not: the fourth difference of
/// successive twists is noise, and where the motion is rough, motion. So rough motion never makes
/// the noise look too small; and it is never taken for larger than the covariance says.
///
/// Turning, approach and shift (what is left of the two velocities along the picture when turning
/// and approach are known) have each their own share.
class TwistNoise {
 public:
  /// The next twist is the first one from a keyframe. It has the errors of the keyframe, too.
  void beginKeyframe() { count_ = -1; }
  /// The next twist of the camera in its own frame, over `seconds`, at this height. `noise`: the
  /// part of its covariance that is independent of other frames.
  void add(const Vector6& twist, const Matrix6& noise, double seconds, double height);
  /// `noise` of the newest twist with the shares that were seen.
  Matrix6 scaled(const Matrix6& noise) const;

 private:
  static constexpr int kTwists = 5;

  std::array<Vector6, kTwists> twists_;  // the newest first
  int count_ = -1;                       // of twists from one keyframe, without the first one
  double seconds_ = 0.0;
  // Of turning, approach and shift: over 30 twists and over 300.
  Eigen::Array3d newer_ = Eigen::Array3d::Ones();
  Eigen::Array3d older_ = Eigen::Array3d::Ones();
  double learned_ = 0.0;  // twists
};

}  // namespace ktgp_orb::motion
