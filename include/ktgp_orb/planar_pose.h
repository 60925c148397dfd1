#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// Neither moves with the instruction set of whoever includes this; see Covariance8.
using Pose3 = Eigen::Transform<double, 3, Eigen::Isometry, Eigen::DontAlign>;
using Covariance6 = Eigen::Matrix<double, 6, 6, Eigen::DontAlign>;

/// Where a flat target is in the camera's frame (x right, y down, z forward).
struct PlanarPose {
  /// Target -> camera. The target's origin is the middle of the reference image, its x and y axes
  /// go right and down in it, z away from who looks at it.
  Pose3 target_to_camera = Pose3::Identity();
  /// Of x, y, z (m) and of small turns about the camera's x, y, z axes (rad), in this order; NaN
  /// where that of the homography is not known.
  Covariance6 covariance = Covariance6::Zero();
};

/// The pose from the homography reference image -> camera image and its covariance (see
/// ProsacResult). `camera`: K of an image without distortion, px; `reference_size`: px;
/// `target_width`: of what the whole width of the reference image shows, m.
///
/// Starts with the decomposition K^-1 H = [r1 r2 t] (Zhang, PAMI 2000) and finds the pose whose
/// homography is nearest to H, as H's covariance measures it. Nothing for a homography that no
/// target before the camera gives. Throws std::invalid_argument for an empty size, and for a width
/// or focal length that is not above zero.
std::optional<PlanarPose> planarPose(const Eigen::Matrix3d& homography,
                                     const Covariance8& covariance, const Eigen::Matrix3d& camera,
                                     const cv::Size& reference_size, double target_width);

}  // namespace ktgp_orb
