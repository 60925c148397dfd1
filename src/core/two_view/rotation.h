#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "core/two_view/cameras.h"
#include "core/two_view/epipolar.h"

namespace ktgp_orb::two_view {

/// A rotation and the covariance of small rotations about the target camera's axes, rad².
struct UncertainRotation {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// The rotation of maximum likelihood (Student's t) over the pairs near `homography`, which has
/// `inliers`; false where it explains less than half of them. `max_error`: px.
bool fitRotation(const PointPairs& pairs, const Cameras& cameras, const Eigen::Matrix3d& homography,
                 std::size_t inliers, double max_error, UncertainRotation& result);

/// The turn that explains the best pairs without a translation: least squares with the weights of
/// Cauchy's distribution.
Eigen::Matrix3d turnOf(const EpipolarPairs& pairs);

/// Whether most of the first pairs are in front of both cameras.
bool isForward(const EpipolarPairs& pairs, const RelativePose& motion);

}  // namespace ktgp_orb::two_view
