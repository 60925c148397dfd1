#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <vector>

#include "core/util/divide.h"

namespace ktgp_orb {

/// Point pairs as four parallel arrays, padded so that loops run over whole groups of `kLanes`.
/// x, y: reference; u, v: target; both in the same units as the homography they are used with.
template <typename Scalar>
struct PointArrays {
  static constexpr std::size_t kLanes = 8;
  using Lanes = Eigen::Array<Scalar, kLanes, 1>;

  static constexpr Scalar kFar = Scalar(1e9);

  std::vector<Scalar> x, y, u, v;
  std::size_t size = 0;  ///< pairs, without the padding

  std::size_t paddedSize() const { return x.size(); }

  /// Makes room for n pairs, whose values are not set yet. The padding lies so far off that no
  /// homography explains it.
  void resize(std::size_t n) {
    const std::size_t padded = util::ceilDivide(n, kLanes) * kLanes;
    size = n;
    for (std::vector<Scalar>* array : {&x, &y, &u, &v}) array->resize(padded);
    for (std::size_t i = n; i < padded; ++i) {
      x[i] = y[i] = Scalar(0);
      u[i] = v[i] = kFar;
    }
  }

  void set(std::size_t i, const Eigen::Vector2d& reference, const Eigen::Vector2d& target) {
    x[i] = static_cast<Scalar>(reference.x());
    y[i] = static_cast<Scalar>(reference.y());
    u[i] = static_cast<Scalar>(target.x());
    v[i] = static_cast<Scalar>(target.y());
  }

  static Lanes load(const std::vector<Scalar>& array, std::size_t first) {
    return Eigen::Map<const Lanes>(array.data() + first);
  }
};

/// Shift to the centroid and scale to a mean distance of about 1 (Hartley, PAMI 1997), without
/// which neither single precision nor the normal equations would do.
struct Normalisation {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double scale = 1.0;

  static Normalisation of(const std::vector<Eigen::Vector2d>& points) {
    Normalisation n;
    const double count = static_cast<double>(points.size());
    for (const Eigen::Vector2d& p : points) n.centre += p;
    n.centre /= count;
    double spread = 0.0;
    for (const Eigen::Vector2d& p : points) spread += (p - n.centre).lpNorm<1>();
    if (spread > 0.0) n.scale = count / spread;
    return n;
  }

  Eigen::Vector2d apply(const Eigen::Vector2d& p) const { return scale * (p - centre); }

  Eigen::Matrix3d matrix() const {
    Eigen::Matrix3d m;
    m << scale, 0.0, -scale * centre.x(), 0.0, scale, -scale * centre.y(), 0.0, 0.0, 1.0;
    return m;
  }

  Eigen::Matrix3d inverse() const {
    Eigen::Matrix3d m;
    m << 1.0 / scale, 0.0, centre.x(), 0.0, 1.0 / scale, centre.y(), 0.0, 0.0, 1.0;
    return m;
  }
};

}  // namespace ktgp_orb
