#include "core/growth/map_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "core/homography/point_pairs.h"

namespace ktgp_orb::growth {
namespace {

using homography::Normalisation;

/// To the centroid, and to a mean distance of 1.
template <typename Place>
Normalisation scalingOf(const std::vector<PlacePair>& pairs, const Place& place) {
  Normalisation s;
  const auto count = static_cast<double>(pairs.size());
  for (const PlacePair& pair : pairs) s.centre += place(pair);
  s.centre /= count;
  double spread = 0.0;
  for (const PlacePair& pair : pairs) spread += (place(pair) - s.centre).norm();
  if (spread > 0.0) s.scale = count / spread;
  return s;
}

double weightOf(const PlacePair& pair, double scale, const Eigen::Matrix3d& map) {
  const Eigen::Vector3d p = map * pair.reference.homogeneous();
  if (!(p.z() > 0.0)) return 0.0;
  const double squared = (p.hnormalized() - pair.target).squaredNorm();
  return 1.0 / (1.0 + squared / (scale * scale));
}

/// Not mirrored, and all pairs on the near side of the horizon.
bool keepsSides(const Eigen::Matrix3d& map, const std::vector<PlacePair>& pairs) {
  if (!map.allFinite() || !(map.determinant() > 0.0)) return false;
  const auto is_in_sight = [&](const PlacePair& pair) {
    return map.row(2).dot(pair.reference.homogeneous()) > 0.0;
  };
  return std::all_of(pairs.begin(), pairs.end(), is_in_sight);
}

}  // namespace

bool fitAffine(const std::vector<PlacePair>& pairs, double scale, Eigen::Matrix3d& map) {
  constexpr double kTooFlat = 1e-3;  // smallest pivot of the points' second moments
  const Normalisation from = scalingOf(pairs, [](const PlacePair& p) { return p.reference; });
  Eigen::Matrix3d sums = Eigen::Matrix3d::Zero();
  Eigen::Matrix<double, 3, 2> products = Eigen::Matrix<double, 3, 2>::Zero();
  for (const PlacePair& pair : pairs) {
    const double weight = weightOf(pair, scale, map);
    const Eigen::Vector3d x = from.apply(pair.reference).homogeneous();
    sums += weight * x * x.transpose();
    products += weight * x * pair.target.transpose();
  }
  const Eigen::LDLT<Eigen::Matrix3d> ldlt(sums);
  if (!(ldlt.vectorD().minCoeff() > kTooFlat)) return false;
  Eigen::Matrix3d fitted = Eigen::Matrix3d::Identity();
  fitted.topRows<2>() = ldlt.solve(products).transpose();
  fitted = fitted * from.matrix();
  if (!keepsSides(fitted, pairs)) return false;
  map = fitted;
  return true;
}

bool fitHomography(const std::vector<PlacePair>& pairs, double scale, Eigen::Matrix3d& map) {
  using Vector8 = Eigen::Matrix<double, 8, 1>;
  using Matrix8 = Eigen::Matrix<double, 8, 8>;
  const Normalisation from = scalingOf(pairs, [](const PlacePair& p) { return p.reference; });
  const Normalisation to = scalingOf(pairs, [](const PlacePair& p) { return p.target; });
  Matrix8 sums = Matrix8::Zero();
  Vector8 products = Vector8::Zero();
  for (const PlacePair& pair : pairs) {
    // Divided by the third coordinate under the previous map, the algebraic error is the geometric
    // one.
    const double depth =
        map.row(2).dot(pair.reference.homogeneous()) / map.row(2).dot(from.centre.homogeneous());
    const double weight = weightOf(pair, scale, map) / std::max(depth * depth, 1e-6);
    const Eigen::Vector2d x = from.apply(pair.reference);
    const Eigen::Vector2d u = to.apply(pair.target);
    Eigen::Matrix<double, 2, 8> rows;
    rows << x.x(), x.y(), 1, 0, 0, 0, -u.x() * x.x(), -u.x() * x.y(),  //
        0, 0, 0, x.x(), x.y(), 1, -u.y() * x.x(), -u.y() * x.y();
    sums.noalias() += weight * rows.transpose() * rows;
    products.noalias() += weight * rows.transpose() * u;
  }
  const Eigen::LDLT<Matrix8> ldlt(sums);
  constexpr double kTooFlat = 1e-4;
  if (!(ldlt.vectorD().minCoeff() > kTooFlat)) return false;
  const Vector8 h = ldlt.solve(products);
  Eigen::Matrix3d fitted;
  fitted << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0;
  fitted = to.matrix().inverse() * fitted * from.matrix();
  if (!keepsSides(fitted, pairs)) return false;
  map = fitted / fitted.row(2).dot(from.centre.homogeneous());
  return true;
}

Eigen::Matrix3d fitAffineNear(const std::vector<PlacePair>& pairs, const PlacePair& centre,
                              const Eigen::Matrix2d& prior, double reach) {
  Eigen::Matrix2d sums = reach * reach * Eigen::Matrix2d::Identity();
  Eigen::Matrix2d products = reach * reach * prior.transpose();
  for (const PlacePair& pair : pairs) {
    const Eigen::Vector2d x = pair.reference - centre.reference;
    sums += x * x.transpose();
    products += x * (pair.target - centre.target).transpose();
  }
  Eigen::Matrix3d map = Eigen::Matrix3d::Identity();
  map.topLeftCorner<2, 2>() = (sums.inverse() * products).transpose();
  map.topRightCorner<2, 1>() = centre.target - map.topLeftCorner<2, 2>() * centre.reference;
  return map;
}

}  // namespace ktgp_orb::growth
