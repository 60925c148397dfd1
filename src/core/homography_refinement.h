#pragma once

#include <Eigen/Core>
#include <vector>

#include "homography_points.h"

namespace ktgp_orb {

/// Least squares on the reprojection error in the target over H's first eight entries, H(2,2) = 1.
/// Keeps its buffers from call to call.
class HomographyRefinement {
 public:
  using Vector8 = Eigen::Matrix<double, 8, 1>;
  using Matrix8 = Eigen::Matrix<double, 8, 8>;

  /// The pairs that the following calls are about: those of `points` whose error is below `limit`.
  /// Returns how many.
  std::size_t select(const PointArrays<double>& points, const Eigen::Matrix3d& homography,
                     double limit);

  /// One Gauss-Newton step with equal weights; false where the pairs do not determine H.
  bool gaussNewtonStep(Eigen::Matrix3d& homography);

  /// Levenberg-Marquardt to convergence. Weights are those of Student's t distribution whose scale
  /// is estimated along with H: keypoints of coarse octaves are several times less exact than
  /// those of fine ones, and equal weights would let the coarse ones dominate.
  /// `min_scale`: lower bound of that scale. False where the pairs do not determine H.
  bool levenbergMarquardt(double min_scale, Eigen::Matrix3d& homography);

  /// Covariance of the eight entries after levenbergMarquardt.
  Matrix8 covariance(const Eigen::Matrix3d& homography);

 private:
  struct Normal {
    Matrix8 jtj;
    Vector8 jtr;
  };
  void residuals(const Eigen::Matrix3d& homography);
  double updateWeights(double min_scale);
  Normal normalEquations(const Eigen::Matrix3d& homography) const;

  PointArrays<double> selected_;
  std::vector<double> squared_, weight_;
  double scale2_ = 0.0;
};

}  // namespace ktgp_orb
