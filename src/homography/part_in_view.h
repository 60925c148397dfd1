#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "homography/transform.h"

namespace ktgp_orb::homography {

/// Returns H with its sign chosen so that the third coordinate of H x is positive where the plane
/// is visible. If H has a horizon, this is the sign with det H > 0. The sign of H(2,2) does not
/// show which side is visible, since the origin may be beyond the horizon.
Eigen::Matrix3d facing(const Eigen::Matrix3d& homography);

/// A point counts as lying on the horizon if the third coordinate of the mapped point is below this
/// share of the largest third coordinate of the mapped corners. At this limit, a pixel of the
/// reference is stretched 10^6 times.
inline constexpr double kAtHorizon = 1e-3;
/// The same for outlines that are drawn or intersected: beyond, they would reach so far out of the
/// image that float coordinates lose their digits.
inline constexpr double kNearHorizon = 0.02;

/// Corners of a part of an image. No heap memory is used.
class PartOfImage {
 public:
  void add(const Eigen::Vector2d& corner) { corners_[size_++] = corner; }
  std::size_t size() const { return size_; }
  const Eigen::Vector2d* begin() const { return corners_.data(); }
  const Eigen::Vector2d* end() const { return corners_.data() + size_; }

 private:
  std::array<Eigen::Vector2d, 8> corners_;  // each of the four sides adds at most two corners
  std::size_t size_ = 0;
};

/// Returns the corners of the part of the image in which the plane is visible. `facing`: homography
/// from facing(). The part ends where the mapped third coordinate is `least` times the largest
/// third coordinate at the corners. There are up to five corners; if there are fewer than three, no
/// part of the image is in view.
PartOfImage partInView(const Eigen::Matrix3d& facing, const FourPoints& corners,
                       double least = kAtHorizon);

}  // namespace ktgp_orb::homography
