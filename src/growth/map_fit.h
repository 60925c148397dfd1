#pragma once

#include <Eigen/Core>
#include <vector>

namespace ktgp_orb::growth {

/// Positions in one image, px; the positions in the other image are in the same order.
using Places = std::vector<Eigen::Vector2d>;

Eigen::Vector2d middleOf(const Places& places);

/// Fits a map by weighted least squares. The weight of a pair is 1 / (1 + (e/scale)²), where e is
/// its error under the given `map`, px. The result is accurate enough to find the next matches.
/// Returns false, with `map` unchanged, if the pairs do not determine a map or if the map mirrors
/// or puts a pair beyond the horizon.
bool fitAffine(const Places& reference, const Places& target, double scale, Eigen::Matrix3d& map);
bool fitHomography(const Places& reference, const Places& target, double scale,
                   Eigen::Matrix3d& map);

/// Least-squares fit of an affine map that maps `from` exactly to `to`. `prior` is a guess at the
/// linear part. It counts as much as two pairs that agree with it exactly and lie `reach` px from
/// `from`, one along each axis. So two or three pairs are enough, even if they lie on a line.
Eigen::Matrix3d fitAffineNear(const Places& reference, const Places& target,
                              const Eigen::Vector2d& from, const Eigen::Vector2d& to,
                              const Eigen::Matrix2d& prior, double reach);

}  // namespace ktgp_orb::growth
