#pragma once

#include <Eigen/Core>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::sequence {

/// A homography with H(2,2) = 1 (unless near zero) and the covariance of its other eight entries,
/// row by row. The identity without uncertainty at first.
struct UncertainHomography {
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();
  Covariance8 covariance = Covariance8::Zero();
};

/// `first`, then `second`: the product, with its covariance to first order for independent errors.
UncertainHomography chained(const UncertainHomography& second, const UncertainHomography& first);

}  // namespace ktgp_orb::sequence
