#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "util/cells.h"
#include "util/divide.h"

namespace ktgp_orb::homography {

/// Point pairs as four parallel arrays, padded so that loops run over whole groups of `kLanes`. x,
/// y: reference points; u, v: target points. All coordinates are in the units of the homography.
template <typename Scalar>
struct PointArrays {
  static constexpr std::size_t kLanes = 8;
  using Lanes = Eigen::Array<Scalar, kLanes, 1>;

  static constexpr Scalar kFar = Scalar(1e9);

  std::vector<Scalar> x, y, u, v;
  std::size_t size = 0;  ///< number of pairs, without the padding

  std::size_t paddedSize() const { return x.size(); }

  /// Makes room for n pairs without setting their values. The target points of the padding are so
  /// far away that no homography explains them.
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

  /// Copies pair `other_i` of `other` to pair `i`.
  void set(std::size_t i, const PointArrays& other, std::size_t other_i) {
    x[i] = other.x[other_i];
    y[i] = other.y[other_i];
    u[i] = other.u[other_i];
    v[i] = other.v[other_i];
  }

  /// Sets near[i] to 1 if the error of pair i is below `limit`, else to 0, and returns the number
  /// of ones. `squared_errors(first)`: squared errors of the kLanes pairs from `first` on.
  template <typename SquaredErrors>
  std::size_t markNear(double limit, const SquaredErrors& squared_errors,
                       std::vector<std::uint8_t>& near) const {
    const Scalar limit2 = static_cast<Scalar>(limit * limit);
    near.resize(size);
    std::size_t count = 0;
    for (std::size_t first = 0; first < size; first += kLanes) {
      const Lanes errors = squared_errors(first);
      const std::size_t lanes = std::min(kLanes, size - first);
      for (std::size_t lane = 0; lane < lanes; ++lane) {
        near[first + lane] = errors[static_cast<Eigen::Index>(lane)] < limit2 ? 1 : 0;
        count += near[first + lane];
      }
    }
    return count;
  }

  /// Largest number of cells along an axis. Keypoints far outside the image are in the last cell.
  static constexpr int kMostCells = 64;
  /// Largest number of cells if all points are in the image and the side is a 16th of its diagonal.
  /// Buffers have at least this size, so that they do not grow from frame to frame.
  static constexpr std::size_t kUsualCells = std::size_t{17} * 17;
  /// Divides the bounding box of the reference points into cells with the given side, at most
  /// kMostCells along each axis, and sets cell[i] to the index of the cell of reference point i.
  /// There must be at least one pair.
  util::Cells findCells(double side, std::vector<std::size_t>& cell) const {
    const auto end = static_cast<std::ptrdiff_t>(size);
    const auto [left, right] = std::minmax_element(x.begin(), x.begin() + end);
    const auto [top, bottom] = std::minmax_element(y.begin(), y.begin() + end);
    util::Cells cells(Eigen::Vector2d::Zero(), {*right - *left, *bottom - *top}, side, kMostCells);
    cell.resize(size);
    for (std::size_t i = 0; i < size; ++i) cell[i] = cells.at(x[i] - *left, y[i] - *top);
    return cells;
  }

  static Lanes load(const std::vector<Scalar>& array, std::size_t first) {
    return Eigen::Map<const Lanes>(array.data() + first);
  }
};

/// Shifts points so that their centroid is the origin, and scales them so that the mean of |x| +
/// |y| is 1 (as in Hartley, PAMI 1997). Without this, single precision and the normal equations
/// would not be accurate enough.
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

  Eigen::Vector2d applyInverse(const Eigen::Vector2d& p) const { return p / scale + centre; }

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

/// Point pairs for the estimation of a homography or an epipolar geometry. They are normalised, and
/// stored both in single and in double precision.
struct NormalisedPairs {
  Normalisation reference, target;
  // Pairs for counting inliers, for which single precision is enough.
  PointArrays<float> scoring;
  PointArrays<double> refinement;  // pairs for the refinement, which needs double precision
  double limit = 0.0;              // the inlier threshold in normalised target units
  // No three points of a sample may form a triangle whose doubled area is below these limits, in
  // normalised units. The limits are the squared inlier threshold.
  double min_reference_area = 0.0;
  double min_target_area = 0.0;

  std::size_t size() const { return scoring.size; }

  /// Normalises the given points. `order(i)`: index of the i-th pair in the input; `threshold`:
  /// inlier threshold, px. `alike`: give both images the same scale, so that distances in them can
  /// be compared.
  template <typename Order>
  void load(const std::vector<Eigen::Vector2d>& reference_points,
            const std::vector<Eigen::Vector2d>& target_points, const Order& order, double threshold,
            bool alike = false) {
    const std::size_t n = reference_points.size();
    reference = Normalisation::of(reference_points);
    target = Normalisation::of(target_points);
    if (alike) reference.scale = target.scale = std::sqrt(reference.scale * target.scale);
    limit = threshold * target.scale;
    min_target_area = limit * limit;
    min_reference_area = threshold * threshold * reference.scale * reference.scale;
    scoring.resize(n);
    refinement.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t index = order(i);
      const Eigen::Vector2d x = reference.apply(reference_points[index]);
      const Eigen::Vector2d u = target.apply(target_points[index]);
      scoring.set(i, x, u);
      refinement.set(i, x, u);
    }
  }

  /// Converts a homography between normalised coordinates to a homography in pixels. The result may
  /// be scaled by any factor.
  Eigen::Matrix3d toPixels(const Eigen::Matrix3d& normalised) const {
    return target.inverse() * normalised * reference.matrix();
  }

  /// Converts a homography from pixels to normalised coordinates, with H(2,2) = 1, so that the
  /// third coordinate is positive at the centre of the reference. Empty if H cannot be the view of
  /// a plane from one side.
  std::optional<Eigen::Matrix3d> fromPixels(const Eigen::Matrix3d& pixel) const {
    // Lower limit of the determinant of H, whose entries are of the order of 1.
    constexpr double kSingular = 1e-12;
    Eigen::Matrix3d h = target.matrix() * pixel * reference.inverse();
    h /= h(2, 2);
    if (!h.allFinite() || !(h.determinant() > kSingular)) return std::nullopt;
    return h;
  }
};

}  // namespace ktgp_orb::homography
