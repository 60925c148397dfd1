#pragma once

#include <Eigen/Core>
#include <array>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// How uncertain H is: largest standard deviation over the corners of where H maps them, in the
/// target, and of where H maps them back from there, in the reference.
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
/// add. Of the shared parts the deviations add: the same error twice is twice the error, and has
/// four times the variance.
UncertainHomography chained(const UncertainHomography& second, const UncertainHomography& first);

}  // namespace ktgp_orb::homography
