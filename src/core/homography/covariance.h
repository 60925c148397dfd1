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

/// A homography with H(2,2) = 1 (unless near zero) and the covariance of its other eight entries,
/// row by row, in two parts. The identity without uncertainty at first.
struct UncertainHomography {
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();
  /// From noise: independent from one homography to the next.
  Covariance8 noise = Covariance8::Zero();
  /// From the smooth field (core/homography/smooth_field.h). A scene that is not a plane, or a lens
  /// that bends, adds much the same error to each homography.
  Covariance8 shared = Covariance8::Zero();

  Covariance8 covariance() const { return noise + shared; }
};

/// `first`, then `second`: the product, with its covariance to first order. Covariances of noise
/// add. Of the shared parts the deviations add: the same error twice is twice the error, and has
/// four times the variance.
UncertainHomography chained(const UncertainHomography& second, const UncertainHomography& first);

}  // namespace ktgp_orb::homography
