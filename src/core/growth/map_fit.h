#pragma once

#include <Eigen/Core>
#include <vector>

namespace ktgp_orb::growth {

/// A position in the reference and one in the target, px.
struct PlacePair {
  Eigen::Vector2d reference;
  Eigen::Vector2d target;
};

/// Weighted least squares, with weights 1 / (1 + (e/scale)²) from the errors e of the given map,
/// px; accurate enough to find the next matches. False, with `map` unchanged, if the pairs do not
/// determine a map, or not one that keeps all of them in front of the camera.
bool fitAffine(const std::vector<PlacePair>& pairs, double scale, Eigen::Matrix3d& map);
bool fitHomography(const std::vector<PlacePair>& pairs, double scale, Eigen::Matrix3d& map);

/// The affine map nearest to all pairs and to the linear map `prior` about `centre`; the latter has
/// the weight of a pair `reach` px away in each direction. So two or three pairs are enough, even
/// on a line.
Eigen::Matrix3d fitAffineNear(const std::vector<PlacePair>& pairs, const PlacePair& centre,
                              const Eigen::Matrix2d& prior, double reach);

}  // namespace ktgp_orb::growth
