#pragma once

#include "core/two_view/cameras.h"

namespace ktgp_orb::two_view {

/// Sets pose, other_pose, pose_covariance and fundamental of a `view` whose homography is that of a
/// plane, with mask. The poses are those of the decomposition (Malis & Vargas, 2007) that see the
/// plane's front. The likelier one agrees better with all pairs; where both agree alike, it faces
/// the plane more. Sets nothing where the camera did not move. `covariance`: of the homography.
void setPlaneMotion(const PointPairs& pairs, const Cameras& cameras, const Covariance8& covariance,
                    double max_error, TwoView& view);

}  // namespace ktgp_orb::two_view
