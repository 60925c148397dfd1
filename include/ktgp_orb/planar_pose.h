#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>

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
  /// Of x, y, z (m) and of small rotations about the camera's x, y, z axes (rad), in this order;
  /// NaN where the covariance of the homography is not known.
  Covariance6 covariance = Covariance6::Zero();
};

/// The pose from the homography reference image -> camera image and its covariance (see
/// ProsacResult). `camera`: K of an image without distortion, px; `reference_size`: px;
/// `target_width`: the width that the whole reference image shows, m.
///
/// Starts with the decomposition K^-1 H = [r1 r2 t] (Zhang, PAMI 2000), then finds the pose whose
/// homography is nearest to H, weighted by H's covariance. Empty for a homography that no target in
/// front of the camera gives. Throws std::invalid_argument for an empty size, and for a width or
/// focal length that is not positive.
std::optional<PlanarPose> planarPose(const Eigen::Matrix3d& homography,
                                     const Covariance8& covariance, const Eigen::Matrix3d& camera,
                                     const cv::Size& reference_size, double target_width);

}  // namespace ktgp_orb
