#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "homography/transform.h"

namespace ktgp_orb::homography {

/// H with the sign that makes the third coordinate positive where the plane is seen: a view of a
/// plane then has det H > 0. H(2,2) = 1 does not tell the side, since the origin may be beyond the
/// horizon.
Eigen::Matrix3d facing(const Eigen::Matrix3d& homography);

/// Third coordinates below this share of the largest one at the corners are at the horizon, where
/// a pixel of the reference is stretched 10^6 times.
inline constexpr double kAtHorizon = 1e-3;

/// Corners of a part of an image; without the heap.
class PartOfImage {
 public:
  void add(const Eigen::Vector2d& corner) { corners_[size_++] = corner; }
  std::size_t size() const { return size_; }
  const Eigen::Vector2d* begin() const { return corners_.data(); }
  const Eigen::Vector2d* end() const { return corners_.data() + size_; }

 private:
  std::array<Eigen::Vector2d, 8> corners_;  // each of four sides adds two at most
  std::size_t size_ = 0;
};

/// The part of the image that `facing` shows: its corners, cut off at `least` times the largest
/// third coordinate. Up to five points; fewer than three where nothing is in view.
PartOfImage partInView(const Eigen::Matrix3d& facing, const FourPoints& corners,
                       double least = kAtHorizon);

}  // namespace ktgp_orb::homography
