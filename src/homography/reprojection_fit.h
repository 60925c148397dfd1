#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "estimation/robust_fit.h"
#include "homography/point_pairs.h"

namespace ktgp_orb::homography {

/// Fits H's first eight entries, with H(2,2) = 1, by maximum likelihood. The reprojection errors in
/// the target are assumed to have Student's t distribution. The reason is that keypoints of coarse
/// octaves are several times less accurate than keypoints of fine octaves. So the errors have heavy
/// tails, and the least accurate pairs would dominate a least-squares fit. Reuses its buffers from
/// call to call.
class ReprojectionFit {
 public:
  using Matrix8 = Eigen::Matrix<double, 8, 8>;

  /// Selects the pairs for the following calls: the first pairs that are marked in `mask`, at most
  /// `max_pairs`. Returns the number of selected pairs.
  std::size_t select(const PointArrays<double>& points, const std::vector<std::uint8_t>& mask,
                     std::size_t max_pairs);

  /// Weights the selected pairs so that all pairs in one cell together count like one pair. `cell`:
  /// side of a cell, in units of the reference. Each pair gets the inverse of the number of pairs
  /// in its cell, scaled to a mean of 1. The weights stay equal, as after select(), if unequal
  /// weights would make the result as noisy as a fit to fewer than 64 equally weighted pairs.
  void weighByCell(double cell);

  /// Takes one step with the given scale of the errors. Returns false if the pairs do not determine
  /// H.
  bool step(double scale, Eigen::Matrix3d& homography);

  /// Iterates until convergence. The scale of the errors, in units of the target, is estimated
  /// together with H. It begins at `scale` and does not become smaller than `min_scale`. Returns
  /// false if the pairs do not determine H.
  bool minimise(double min_scale, double& scale, Eigen::Matrix3d& homography);

  /// Covariance of the eight entries after minimise(); the scale of the errors is treated as known.
  Matrix8 covariance() const;

  /// Returns the covariance of a fit to the first `count` pairs, but without each pair whose index
  /// modulo `folds` is `fold`. Infinite if the remaining pairs do not determine H.
  Matrix8 covarianceWithout(const Eigen::Matrix3d& homography, std::size_t count, std::size_t fold,
                            std::size_t folds) const;

  std::size_t size() const { return problem_.pairs.size; }
  /// Degrees of freedom of the estimated scale.
  double freedom() const { return fit_.weights().freedom(); }
  /// The selected pairs, their weights w in the last iteration of minimise(), and the ratio of the
  /// second derivative of the likelihood to J^T w J (J: Jacobian).
  const PointArrays<double>& pairs() const { return problem_.pairs; }
  const std::vector<double>& weights() const { return fit_.weights().weight; }
  double curvature() const { return fit_.sums().derivative / fit_.sums().weight; }

 private:
  struct Problem {
    using State = Eigen::Matrix3d;
    PointArrays<double> pairs;

    static State moved(const State& homography, const estimation::Step& step);
    void linearise(const State& homography, estimation::RobustWeights& weights,
                   estimation::NormalEquations& sums) const;
  };

  Problem problem_;
  estimation::RobustFit<Problem> fit_;
  bool by_cell_ = false;              // true if weighByCell() has set factor_
  std::vector<double> factor_;        // weight factor c of each pair
  std::vector<std::size_t> cell_;     // index of the cell of each pair
  std::vector<std::size_t> in_cell_;  // number of pairs in each cell
  double variance_factor_ = 0.0;      // covariance() multiplies by this; set by minimise()
  Matrix8 by_squares_;                // sum of J^T c w J; set by minimise() if by_cell_ is true
};

}  // namespace ktgp_orb::homography
