#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "homography/transform.h"

namespace ktgp_orb::homography {

/// H with the sign for which the third coordinate is positive where the plane is visible; then
/// det H > 0. H(2,2) = 1 does not tell the visible side, since the origin may be beyond the
/// horizon.
Eigen::Matrix3d facing(const Eigen::Matrix3d& homography);

/// A point is at the horizon if its third coordinate is below this share of the largest one at the
/// corners. There, a pixel of the reference is stretched 10^6 times.
inline constexpr double kAtHorizon = 1e-3;

/// Corners of a part of an image, without heap memory.
class PartOfImage {
 public:
  void add(const Eigen::Vector2d& corner) { corners_[size_++] = corner; }
  std::size_t size() const { return size_; }
  const Eigen::Vector2d* begin() const { return corners_.data(); }
  const Eigen::Vector2d* end() const { return corners_.data() + size_; }

 private:
  std::array<Eigen::Vector2d, 8> corners_;  // each of the four sides adds at most two
  std::size_t size_ = 0;
};

/// Corners of the part of the image that `facing` shows, which ends at `least` times the largest
/// third coordinate of the corners. There are up to five; fewer than three mean an empty view.
PartOfImage partInView(const Eigen::Matrix3d& facing, const FourPoints& corners,
                       double least = kAtHorizon);

}  // namespace ktgp_orb::homography
