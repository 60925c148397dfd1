#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/homography/point_pairs.h"

namespace ktgp_orb::homography {

/// Maximum likelihood over H's first eight entries, H(2,2) = 1, for reprojection errors in the
/// target that follow Student's t distribution with four degrees of freedom. Keypoints of coarse
/// octaves are several times less exact than those of fine ones: that makes heavy tails, and least
/// squares would let the least exact pairs dominate. Keeps its buffers from call to call.
class MEstimator {
 public:
  using Vector8 = Eigen::Matrix<double, 8, 1>;
  using Matrix8 = Eigen::Matrix<double, 8, 8>;

  /// The pairs that the following calls are about: the first `max_pairs` marked in `mask`.
  /// Returns how many.
  std::size_t select(const PointArrays<double>& points, const std::vector<std::uint8_t>& mask,
                     std::size_t max_pairs);

  /// One Gauss-Newton step with the scale of the errors given; false where H is not determined.
  bool step(double scale, Eigen::Matrix3d& homography);

  /// Levenberg-Marquardt to convergence. The scale of the errors, in units of the target, is
  /// estimated along with H, from the one given and not below `min_scale`. False where the pairs do
  /// not determine H.
  bool minimise(double min_scale, double& scale, Eigen::Matrix3d& homography);

  /// Covariance of the eight entries after minimise(), as if the scale of the errors were known.
  Matrix8 covariance() const;

  /// The degrees of freedom that the scale was estimated with: two errors a pair, less the eight
  /// entries that were fitted to them.
  double freedom() const;

  /// The covariance from the first `count` pairs only, and of these without each pair whose place
  /// leaves the remainder `fold` when divided by `folds`. Infinite where the rest does not
  /// determine H.
  Matrix8 covarianceWithout(const Eigen::Matrix3d& homography, std::size_t count, std::size_t fold,
                            std::size_t folds) const;

  std::size_t size() const { return selected_.size; }

  /// The selected pairs, their weights in the last iteration of minimise(), and the second
  /// derivative of the likelihood over J^T w J.
  const PointArrays<double>& pairs() const { return selected_; }
  const std::vector<double>& weights() const { return weight_; }
  double curvature() const { return sums_.derivative / sums_.weight; }

 private:
  /// Sums over the selected pairs at one H; e: reprojection error, w: its weight.
  struct Sums {
    Matrix8 jtj;               // of J^T w J, J the Jacobian of the error
    Vector8 jtr;               // of J^T w e
    double weight = 0.0;       // of w
    double derivative = 0.0;   // of d(w e)/de, the mean over both directions
    double square = 0.0;       // of w² e²
    double cost = 0.0;         // of w e²
    double former_cost = 0.0;  // of w e² with the weights of the H before
  };

  void reweight(const Eigen::Matrix3d& homography, Sums& sums);
  double varianceFactor() const;
  void estimateScale(double min_scale);

  PointArrays<double> selected_;
  std::vector<double> squared_;        // e²
  std::vector<double> weight_;         // w at the H that reweight() saw last
  std::vector<double> former_weight_;  // w at the H before
  double scale2_ = 0.0;
  double variance_factor_ = 0.0;  // covariance over (J^T w J)^-1, after minimise()
  Sums sums_;
};

}  // namespace ktgp_orb::homography
