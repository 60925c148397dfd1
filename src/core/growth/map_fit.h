#pragma once

#include <Eigen/Core>
#include <vector>

namespace ktgp_orb::growth {

/// A place in the reference and one in the target, px.
struct PlacePair {
  Eigen::Vector2d reference;
  Eigen::Vector2d target;
};

/// Weighted least squares, weights 1 / (1 + (e/scale)²) from the errors e of the map handed in, px:
/// good enough to find the next matches by. False, and `map` untouched, where the pairs do not
/// determine one that keeps its sides in sight of all of them.
bool fitAffine(const std::vector<PlacePair>& pairs, double scale, Eigen::Matrix3d& map);
bool fitHomography(const std::vector<PlacePair>& pairs, double scale, Eigen::Matrix3d& map);

/// The affine map nearest to all pairs and, with the weight of a pair `reach` px away in either
/// direction, to the linear map `prior` about `centre`: so that two or three pairs, on a line
/// perhaps, are enough.
Eigen::Matrix3d fitAffineNear(const std::vector<PlacePair>& pairs, const PlacePair& centre,
                              const Eigen::Matrix2d& prior, double reach);

}  // namespace ktgp_orb::growth
