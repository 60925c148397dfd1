#include "growth/map_fit.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cstddef>

#include "homography/point_pairs.h"
#include "util/small_matrix.h"

namespace ktgp_orb::growth {
namespace {

using homography::Normalisation;
using Vector8 = Eigen::Matrix<double, 8, 1>;
using Matrix8 = Eigen::Matrix<double, 8, 8>;

/// The transform that moves the centroid of the places to zero and scales their mean distance from
/// zero to 1.
Normalisation scalingOf(const Places& places) {
  Normalisation s;
  s.centre = middleOf(places);
  double spread = 0.0;
  for (const Eigen::Vector2d& place : places) spread += (place - s.centre).norm();
  if (spread > 0.0) s.scale = static_cast<double>(places.size()) / spread;
  return s;
}

double weightOf(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double scale,
                const Eigen::Matrix3d& map) {
  const Eigen::Vector3d p = map * from.homogeneous();
  if (!(p.z() > 0.0)) return 0.0;
  const double squared = (p.hnormalized() - to).squaredNorm();
  return 1.0 / (1.0 + squared / (scale * scale));
}

/// Adds the equation `row` * h = `value` to the normal equations, where h has the eight unknown
/// entries of the homography. This is done column by column, because Eigen products of these sizes
/// take long to compile.
void add(const Vector8& row, double value, double weight, Matrix8& sums, Vector8& products) {
  const Vector8 weighted = weight * row;
  for (int i = 0; i < 8; ++i) sums.col(i) += row[i] * weighted;
  products += value * weighted;
}

/// Returns true if the map does not mirror, and all places are on the visible side of its horizon.
bool keepsSides(const Eigen::Matrix3d& map, const Places& reference) {
  if (!map.allFinite() || !(map.determinant() > 0.0)) return false;
  const auto is_in_sight = [&](const Eigen::Vector2d& place) {
    return map.row(2).dot(place.homogeneous()) > 0.0;
  };
  return std::all_of(reference.begin(), reference.end(), is_in_sight);
}

}  // namespace

Eigen::Vector2d middleOf(const Places& places) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& place : places) sum += place;
  return sum / static_cast<double>(places.size());
}

bool fitAffine(const Places& reference, const Places& target, double scale, Eigen::Matrix3d& map) {
  constexpr double kTooFlat = 1e-3;  // if a pivot of `sums` is smaller, the points lie on a line
  const Normalisation from = scalingOf(reference);
  Eigen::Matrix3d sums = Eigen::Matrix3d::Zero();
  Eigen::Matrix<double, 3, 2> products = Eigen::Matrix<double, 3, 2>::Zero();
  for (std::size_t i = 0; i < reference.size(); ++i) {
    const double weight = weightOf(reference[i], target[i], scale, map);
    const Eigen::Vector3d x = from.apply(reference[i]).homogeneous();
    sums += weight * x * x.transpose();
    products += weight * x * target[i].transpose();
  }
  const auto solution = util::solutionOf(sums, products, kTooFlat);
  if (!solution) return false;
  Eigen::Matrix3d fitted = Eigen::Matrix3d::Identity();
  fitted.topRows<2>() = solution->transpose();
  fitted = fitted * from.matrix();
  if (!keepsSides(fitted, reference)) return false;
  map = fitted;
  return true;
}

bool fitHomography(const Places& reference, const Places& target, double scale,
                   Eigen::Matrix3d& map) {
  // If a pivot of `sums` is smaller, the pairs do not determine the homography.
  constexpr double kTooFlat = 1e-4;
  const Normalisation from = scalingOf(reference);
  const Normalisation to = scalingOf(target);
  Matrix8 sums = Matrix8::Zero();
  Vector8 products = Vector8::Zero();
  for (std::size_t i = 0; i < reference.size(); ++i) {
    // Dividing the equations by the third coordinate under the previous map turns the algebraic
    // error into a geometric error.
    const double depth =
        map.row(2).dot(reference[i].homogeneous()) / map.row(2).dot(from.centre.homogeneous());
    const double weight =
        weightOf(reference[i], target[i], scale, map) / std::max(depth * depth, 1e-6);
    const Eigen::Vector2d x = from.apply(reference[i]);
    const Eigen::Vector2d u = to.apply(target[i]);
    Vector8 row;
    row << x.x(), x.y(), 1, 0, 0, 0, -u.x() * x.x(), -u.x() * x.y();
    add(row, u.x(), weight, sums, products);
    row << 0, 0, 0, x.x(), x.y(), 1, -u.y() * x.x(), -u.y() * x.y();
    add(row, u.y(), weight, sums, products);
  }
  const auto solution = util::solutionOf(sums, products, kTooFlat);
  if (!solution) return false;
  const Vector8 h = *solution;
  Eigen::Matrix3d fitted;
  fitted << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0;
  fitted = to.matrix().inverse() * fitted * from.matrix();
  if (!keepsSides(fitted, reference)) return false;
  map = fitted / fitted.row(2).dot(from.centre.homogeneous());
  return true;
}

Eigen::Matrix3d fitAffineNear(const Places& reference, const Places& target,
                              const Eigen::Vector2d& from, const Eigen::Vector2d& to,
                              const Eigen::Matrix2d& prior, double reach) {
  Eigen::Matrix2d sums = reach * reach * Eigen::Matrix2d::Identity();
  Eigen::Matrix2d products = reach * reach * prior.transpose();
  for (std::size_t i = 0; i < reference.size(); ++i) {
    const Eigen::Vector2d x = reference[i] - from;
    sums += x * x.transpose();
    products += x * (target[i] - to).transpose();
  }
  Eigen::Matrix3d map = Eigen::Matrix3d::Identity();
  map.topLeftCorner<2, 2>() = (sums.inverse() * products).transpose();
  map.topRightCorner<2, 1>() = to - map.topLeftCorner<2, 2>() * from;
  return map;
}

}  // namespace ktgp_orb::growth
