#pragma once

#include <Eigen/Core>
#include <array>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// Uncertainty of H: the largest standard deviation of the mapped corners in the target, and of the
/// corners mapped back in the reference.
struct CornerDeviation {
  double target = 0.0;
  double reference = 0.0;
};

/// The root of the trace of the covariance propagated from that of H's first eight entries, with
/// H(2,2) = 1, in the units of H. Infinite where undefined.
CornerDeviation cornerDeviation(const Eigen::Matrix3d& homography,
                                const Eigen::Matrix<double, 8, 8>& covariance,
                                const std::array<Eigen::Vector2d, 4>& corners);

/// `first`, then `second`: the product, with its covariance to first order. Covariances of noise
/// add. For the shared parts the deviations add: the same error twice has twice the deviation and
/// four times the variance.
UncertainHomography chained(const UncertainHomography& second, const UncertainHomography& first);

}  // namespace ktgp_orb::homography
