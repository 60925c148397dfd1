#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/homography/point_pairs.h"

namespace ktgp_orb::homography {

/// MSAC cost (Torr & Zisserman, CVIU 2000): sum over the pairs of min(e², limit²), with e the
/// reprojection error in the target, over the noise of the pair. Stops as soon as the sum exceeds
/// `give_up` and returns the partial sum, so a cost below `give_up` is complete.
float msacCost(const PointArrays<float>& points, const Eigen::Matrix3d& homography, double limit,
               float give_up);

/// inlier[i] = 1 where e < limit, else 0; one entry per pair. Returns the number of ones.
std::size_t findInliers(const PointArrays<float>& points, const Eigen::Matrix3d& homography,
                        double limit, std::vector<std::uint8_t>& inlier);

}  // namespace ktgp_orb::homography
