#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// Unaligned, so that the layout is the same for every instruction set; see Covariance8.
using Pose3 = Eigen::Transform<double, 3, Eigen::Isometry, Eigen::DontAlign>;
using Covariance6 = Eigen::Matrix<double, 6, 6, Eigen::DontAlign>;

/// Pose of a flat target in the camera's frame (x right, y down, z forward).
struct PlanarPose {
  /// Target -> camera. The origin of the target is the middle of the reference image; its x axis
  /// points right, y down, and z away from the viewer.
  Pose3 target_to_camera = Pose3::Identity();
  /// Covariance of x, y, z (m) and of small rotations about the camera's x, y, z axes (rad).
  Covariance6 covariance = Covariance6::Zero();
  /// Squared distance of its homography from the given one in units of the covariance, with two
  /// degrees of freedom.
  double squared_error = 0.0;
  /// Likelihood of this pose against the other one, 0..1; 1: there is no other one. The covariance
  /// of the homography is taken for a guess of the scale of its errors.
  double share = 1.0;
};

struct PlanarPoses {
  /// None, one, or two, the likelier one first: seen nearly from the front, and from afar, a plane
  /// that tilts to the left looks as if it tilted to the right.
  std::vector<PlanarPose> poses;
  std::string problem;  ///< why there is no pose
};

/// The poses from the homography reference image -> camera image and its covariance (see
/// UncertainHomography). `camera`: K of an image without distortion, px; `reference_size`: px;
/// `target_width`: the width that the whole reference image shows, m.
///
/// Starts at both solutions of IPPE (Collins & Bartoli, IJCV 2014), and finds from each the pose
/// whose homography is nearest to the given one, weighted by its covariance (Levenberg-Marquardt).
/// Where both lead to one pose, and its covariance does not reach the other solution, that one is
/// the second pose with the rotation of IPPE. None for a homography that no target in front of the
/// camera gives, without a covariance that is positive definite, and where neither start converges.
/// Throws std::invalid_argument for an empty size, and for a width or focal length that is not
/// positive.
PlanarPoses planarPoses(const Eigen::Matrix3d& homography, const Covariance8& covariance,
                        const Eigen::Matrix3d& camera, const cv::Size& reference_size,
                        double target_width);

/// The homography `now`, reference image -> camera image, as it would be if all rows had been
/// exposed with the middle one.
///
/// A rolling shutter exposes each of the `rows` later than the one above it, the last one by
/// `readout_time`, s. `before` is the homography of an image `seconds` earlier: it tells how fast
/// the points of the target move, and they are moved back to the time of the middle row. The
/// covariance has the noise of both homographies, but not a velocity that changes between them.
/// `readout_time` between -1 and 0: the last row is exposed first, as in pictures that the driver
/// turns by 180 degrees; -1: it is not known. Then the homography is that of `now`, and its
/// covariance has a readout time of 0 +- 10 ms. planarPoses() needs only six of the eight numbers,
/// so the bending by the shutter changes the pose little, and its covariance contains that. Returns
/// `now` where one of the two does not show all of the reference image, and where the time between
/// them is too short. Throws std::invalid_argument for an empty size, no rows, `seconds` of 0 or
/// less, and a `readout_time` that is not a number.
UncertainHomography withoutShutter(const UncertainHomography& now,
                                   const UncertainHomography& before, double seconds,
                                   double readout_time, const cv::Size& reference_size, int rows);

}  // namespace ktgp_orb
