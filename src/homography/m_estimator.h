#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "homography/point_pairs.h"

namespace ktgp_orb::homography {

/// Maximum likelihood over H's first eight entries, H(2,2) = 1, for reprojection errors in the
/// target with Student's t distribution of four degrees of freedom. Keypoints of coarse octaves are
/// several times less accurate than those of fine ones. That gives heavy tails, and in least
/// squares the least accurate pairs would dominate. Keeps its buffers from call to call.
class MEstimator {
 public:
  using Vector8 = Eigen::Matrix<double, 8, 1>;
  using Matrix8 = Eigen::Matrix<double, 8, 8>;

  /// Selects the pairs for the following calls: the first `max_pairs` marked in `mask`. Returns
  /// their number.
  std::size_t select(const PointArrays<double>& points, const std::vector<std::uint8_t>& mask,
                     std::size_t max_pairs);

  /// Weighs the selected pairs so that those in one cell of side `cell`, in units of the reference,
  /// count together like one: each gets the inverse of their number, 1 on average. But equal
  /// weights, as after select(), where the result would be as noisy as that of fewer than 64
  /// equally weighted pairs.
  void weighByCell(double cell);

  /// One Gauss-Newton step with the given scale of the errors; false where H is not determined.
  bool step(double scale, Eigen::Matrix3d& homography);

  /// Levenberg-Marquardt to convergence. The scale of the errors, in units of the target, is
  /// estimated together with H, beginning with the given one and not below `min_scale`. False where
  /// the pairs do not determine H.
  bool minimise(double min_scale, double& scale, Eigen::Matrix3d& homography);

  /// Covariance of the eight entries after minimise(), as if the scale of the errors were known.
  Matrix8 covariance() const;

  /// The degrees of freedom of the estimated scale: two errors per pair minus the eight fitted
  /// entries. Unequal weights have those of as many equal ones as give the same variance.
  double freedom() const;

  /// The covariance from the first `count` pairs, without each pair whose index modulo `folds` is
  /// `fold`. Infinite where the rest does not determine H.
  Matrix8 covarianceWithout(const Eigen::Matrix3d& homography, std::size_t count, std::size_t fold,
                            std::size_t folds) const;

  std::size_t size() const { return selected_.size; }

  /// The selected pairs, their weights (both factors) in the last iteration of minimise(), and the
  /// second derivative of the likelihood over J^T w J.
  const PointArrays<double>& pairs() const { return selected_; }
  const std::vector<double>& weights() const { return weight_; }
  double curvature() const { return sums_.derivative / sums_.weight; }

 private:
  /// Sums over the selected pairs at one H; e: reprojection error, J: its Jacobian, w = t c: its
  /// weight, t: of Student's distribution, c: of the cell.
  struct Sums {
    Matrix8 jtj;               // of J^T w J
    Vector8 jtr;               // of J^T w e
    double weight = 0.0;       // of w
    double derivative = 0.0;   // of c d(t e)/de, the mean over both directions
    double square = 0.0;       // of c t² e²
    double cost = 0.0;         // of w e²
    double former_cost = 0.0;  // of w e² with the previous weights
  };

  void reweight(const Eigen::Matrix3d& homography, Sums& sums);
  double varianceFactor() const;
  void estimateScale(double min_scale);

  PointArrays<double> selected_;
  std::vector<double> cell_weight_;    // c
  bool by_cell_ = false;               // not all of them are 1
  double equal_pairs_ = 0.0;           // with equal weights and the same variance
  std::vector<std::size_t> cell_;      // of each pair
  std::vector<std::size_t> in_cell_;   // number of pairs
  std::vector<double> squared_;        // e²
  std::vector<double> weight_;         // w at the H of the last reweight()
  std::vector<double> former_weight_;  // w at the previous H
  double scale2_ = 0.0;
  double variance_factor_ = 0.0;  // covariance over (J^T w J)^-1, after minimise()
  Matrix8 by_squares_;            // of J^T c w J, after minimise() by cell
  Sums sums_;
};

}  // namespace ktgp_orb::homography
