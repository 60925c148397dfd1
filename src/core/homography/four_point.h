#pragma once

#include <Eigen/Core>
#include <array>

namespace ktgp_orb::homography {

/// Four points of one image.
using FourPoints = std::array<Eigen::Vector2d, 4>;

/// The homography that maps four reference points to four target points, in closed form.
/// Returns false, before solving, where it cannot be the view of a plane from one side: a triangle
/// of three of the points is flat (doubled area below `min_area`: collinear or duplicate points) or
/// has opposite orientations in the two images. On success H x has a positive third coordinate at
/// the four points.
bool solveFourPoints(const FourPoints& reference, const FourPoints& target,
                     double min_reference_area, double min_target_area,
                     Eigen::Matrix3d& homography);

}  // namespace ktgp_orb::homography
