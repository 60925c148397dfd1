#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <cstddef>
#include <optional>
#include <vector>

#include "core/homography/points.h"

namespace ktgp_orb {

/// Point pairs as the estimation of a homography works on them: normalised, in single precision
/// where that is enough.
struct HomographyProblem {
  Normalisation reference, target;
  PointArrays<float> scoring;       // single precision is enough to count inliers ...
  PointArrays<double> refinement;   // ... but not to refine
  double limit = 0.0;               // the inlier threshold in normalised target units
  double min_reference_area = 0.0;  // square of the threshold, in normalised units of each image:
  double min_target_area = 0.0;     // triangles below that are too flat to sample

  std::size_t size() const { return scoring.size; }

  /// `order[i]` is the index of the pair that comes at place i; `threshold` in px.
  template <typename Order>
  void load(const std::vector<Eigen::Vector2d>& reference_points,
            const std::vector<Eigen::Vector2d>& target_points, const Order& order,
            double threshold) {
    const std::size_t n = reference_points.size();
    reference = Normalisation::of(reference_points);
    target = Normalisation::of(target_points);
    limit = threshold * target.scale;
    min_target_area = limit * limit;
    min_reference_area = threshold * threshold * reference.scale * reference.scale;
    scoring.resize(n);
    refinement.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t index = order[i];
      const Eigen::Vector2d x = reference.apply(reference_points[index]);
      const Eigen::Vector2d u = target.apply(target_points[index]);
      scoring.set(i, x, u);
      refinement.set(i, x, u);
    }
  }

  /// A homography between normalised coordinates in pixels; of any scale.
  Eigen::Matrix3d toPixels(const Eigen::Matrix3d& normalised) const {
    return target.inverse() * normalised * reference.matrix();
  }

  /// The way back, with H(2,2) = 1: the third coordinate is positive at the centre of the reference
  /// points. None where H is no view of a plane from one side.
  std::optional<Eigen::Matrix3d> fromPixels(const Eigen::Matrix3d& pixel) const {
    constexpr double kSingular = 1e-12;  // the determinant, of entries of the order of 1
    Eigen::Matrix3d h = target.matrix() * pixel * reference.inverse();
    h /= h(2, 2);
    if (!h.allFinite() || !(h.determinant() > kSingular)) return std::nullopt;
    return h;
  }
};

}  // namespace ktgp_orb
