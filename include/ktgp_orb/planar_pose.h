#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// DontAlign gives these types the same layout for every instruction set; see Covariance8.
using Pose3 = Eigen::Transform<double, 3, Eigen::Isometry, Eigen::DontAlign>;
using Covariance6 = Eigen::Matrix<double, 6, 6, Eigen::DontAlign>;

/// Pose of a flat target in the camera's frame (x right, y down, z forward).
struct PlanarPose {
  /// Transform from the target's frame to the camera's frame. The origin of the target's frame is
  /// the middle of the reference image; x points right, y down, and z away from the viewer.
  Pose3 target_to_camera = Pose3::Identity();
  /// Covariance of x, y, z (m) and of small rotations about the camera's x, y, z axes (rad).
  Covariance6 covariance = Covariance6::Zero();
  /// Squared Mahalanobis distance between the homography of this pose and the given homography. It
  /// has two degrees of freedom: eight entries of H minus six parameters of a pose.
  double squared_error = 0.0;
  /// Likelihood of this pose, divided by the sum of the likelihoods of both poses, 0..1; 1 if there
  /// is no other pose. The likelihood assumes that the scale of the homography's covariance is only
  /// roughly known, because the covariance does not include, for example, the effect of a wrong K.
  double share = 1.0;
};

struct PlanarPoses {
  /// No pose, one pose, or two poses with the likelier pose first. There are two if the plane is
  /// seen nearly from the front and from afar, because a tilt to the left then looks the same as a
  /// tilt to the right.
  std::vector<PlanarPose> poses;
  std::string problem;  ///< reason why there is no pose; empty if there is a pose
};

/// Computes the poses from the homography (reference image -> camera image) and its covariance; see
/// UncertainHomography. `camera`: K of an image without distortion, px; `reference_size`: px;
/// `target_width`: width of the object, m; the reference image shows the object from its left to
/// its right side.
///
/// Starts at both solutions of IPPE (Collins & Bartoli, IJCV 2014). From each, Levenberg-Marquardt
/// finds the pose whose homography is nearest to the given homography, weighted by the covariance.
/// If the errors are large, both fits may end at the same pose. If one of the two IPPE solutions
/// then has a rotation that the covariance of this pose does not include, it becomes the second
/// pose: its rotation is kept, and only its position is fitted. There is no pose if the homography
/// does not show a target in front of the camera, if the covariance is not positive definite, or if
/// the fit converges from neither of the two starts. Throws std::invalid_argument for an empty
/// size, a width that is not positive, and a K that is not finite, has a focal length that is not
/// positive, or is not upper triangular with 1 as its last entry.
PlanarPoses planarPoses(const Eigen::Matrix3d& homography, const Covariance8& covariance,
                        const Eigen::Matrix3d& camera, const cv::Size& reference_size,
                        double target_width);

/// Returns the homography `now` (reference image -> camera image) as it would be if all rows had
/// been exposed at the same time as the middle row.
///
/// A rolling shutter exposes each of the `rows` later than the row above it; `readout_time` is the
/// time from the first to the last row, s. `before` is the homography of an image `seconds`
/// earlier. The two homographies show how fast the points of the target move, so that the points
/// can be moved to their positions at the time of the middle row. The covariance contains the noise
/// of both homographies, but not the error due to a change of velocity between them. If
/// `readout_time` is between -1 and 0, the last row is exposed first, for example because the
/// driver rotates the images by 180 degrees. If it is -1, the time is not known: the homography
/// stays `now`, and the covariance allows for a readout time of 0 +- 10 ms. Even then, the shutter
/// changes the pose of planarPoses() little: a pose has only six of the eight parameters of a
/// homography and cannot follow most of the distortion. The covariance covers this change. Returns
/// `now` if one of the two homographies does not show all of the reference image, or if the time
/// between the two images is too short. Throws std::invalid_argument for an empty size, no rows,
/// `seconds` of 0 or less, and a `readout_time` that is not a number.
UncertainHomography withoutShutter(const UncertainHomography& now,
                                   const UncertainHomography& before, double seconds,
                                   double readout_time, const cv::Size& reference_size, int rows);

}  // namespace ktgp_orb
