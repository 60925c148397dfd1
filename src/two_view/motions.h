#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "two_view/cameras.h"
#include "two_view/epipolar.h"

namespace ktgp_orb::two_view {

/// Sets pose, other, pose_covariance and fundamental of a `view` whose homography is that of a
/// plane, with mask. The poses are those of the decomposition (Malis & Vargas, 2007) that see the
/// plane's front. The likelier one agrees better with all pairs; where both agree alike, it faces
/// the plane more. Sets nothing where the camera did not move. `covariance`: of the homography.
void setPlaneMotion(const PointPairs& pairs, const Cameras& cameras, const Covariance8& covariance,
                    double max_error, TwoView& view);

/// The rotation of maximum likelihood (Student's t) over the pairs near `homography`, which has
/// `inliers`; false where it explains less than half of them. `max_error`: px. `covariance`: of
/// small rotations about the target camera's axes, rad².
bool fitRotation(const PointPairs& pairs, const Cameras& cameras, const Eigen::Matrix3d& homography,
                 std::size_t inliers, double max_error, Eigen::Matrix3d& rotation,
                 Eigen::Matrix3d& covariance);

/// The turn that explains the best pairs without a translation: least squares with the weights of
/// Cauchy's distribution.
Eigen::Matrix3d turnOf(const EpipolarPairs& pairs);

/// Whether most of the first pairs are in front of both cameras.
bool isForward(const EpipolarPairs& pairs, const RelativePose& motion);

}  // namespace ktgp_orb::two_view
