#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "core/homography/point_pairs.h"

namespace ktgp_orb::homography {

/// Sizes that the smooth field is told with, all in the units of the reference points.
struct FieldScales {
  double image_diagonal = 0.0;
  /// A field is told from noise beyond so many deviations of what noise alone gives.
  double significance = 0.0;
  double nearby = 0.0;  ///< pairs that are nearer than this, in x and y, may share their noise
};

/// The errors of the pairs as a smooth field plus noise.
struct FieldFit {
  double variance = 0.0;     ///< tau² of the field, per coordinate, in squared units of the target
  double noise_share = 1.0;  ///< share of the squared errors that is noise, 0..1
  /// Covariance of H's first eight entries that comes from the field alone.
  Eigen::Matrix<double, 8, 8> covariance = Eigen::Matrix<double, 8, 8>::Zero();
  /// The same from an error that all pairs have in common, a quarter of the deviation of their
  /// noise. Interpolation makes sub-pixel registration of patches err alike where they lie alike
  /// between the pixels (Schreier, Braasch & Sutton, Optical Engineering 39, 2000).
  Eigen::Matrix<double, 8, 8> common_covariance = Eigen::Matrix<double, 8, 8>::Zero();
  /// How many times fewer the independent pairs are than the pairs, >= 1, where each was found with
  /// a patch of the side FieldScales::nearby and patches overlap: the variance of the mean of
  /// values that correlate as their patches overlap, over that of independent ones.
  double shared_patches = 1.0;
};

/// Tells a smooth field from noise in the reprojection errors of an estimated homography.
///
/// On real scenes the errors of neighbours are alike: the scene is not quite a plane, the lens
/// bends, the shutter rolls. More pairs do not average that out, and a covariance that takes the
/// errors as independent is several times too small. The model is the covariance
///
///   K = tau² exp(-d/l) + sigma² (d = 0),   d = |dx| + |dy| in the reference image,
///
/// in each coordinate, with l = 0.6 of the image's diagonal. tau² and sigma² are those for which
/// the sum of the squared errors, and the sum of the products of the errors of near pairs, are what
/// they are expected to be: the fit of eight entries made the errors smaller, E[r r'] = M K M' with
/// M = I - J A^-1 J'W. Then cov(H) = A^-1 J'W K W J A^-1, A = J'WJ (White 1980; Conley 1999; Bell &
/// McCaffrey 2002). The errors are summed up over cells of a 16th of the diagonal, near are pairs
/// in the same or in touching cells, and the field is taken as constant within a cell. Pairs that
/// may share their noise (FieldScales::nearby) are left out. Keeps its buffers.
class SmoothField {
 public:
  /// `weights`: of the pairs in the fit of H; `curvature`: the second derivative of the likelihood
  /// over J'WJ, 1 for least squares. From at most 300 of the pairs, spread over the list.
  FieldFit fit(const PointArrays<double>& pairs, const std::vector<double>& weights,
               double curvature, const Eigen::Matrix3d& homography, const FieldScales& scales);

 private:
  using Matrix8 = Eigen::Matrix<double, 8, 8>;
  /// The entries of a pair's Jacobian that differ: x y z, u x, u y, v x, v y (see m_estimator.cpp).
  /// The eighth is zero: Eigen has vector code for eight doubles and none for seven.
  using Slope = Eigen::Matrix<double, 8, 1>;

  struct Pair {
    Slope slope;
    Eigen::Vector2d point, error;
    double weight = 0.0;  ///< 1 on average
    std::size_t cell = 0;
  };
  struct Cell {
    double weight = 0.0;                              // sums over its pairs of w,
    Eigen::Vector2d error = Eigen::Vector2d::Zero();  // w r,
    Slope slope = Slope::Zero();                      // w J,
    Slope slope2 = Slope::Zero();                     // w² J;
    Slope smoothed = Slope::Zero();                   // sum over all cells of w J exp(-d/l)
  };
  /// A statistic of the errors, and what is expected of it for tau² = 1 and for sigma² = 1.
  struct Moment {
    double measured = 0.0;
    double of_field = 0.0;
    double of_noise = 0.0;
    double deviation = 0.0;  // of `measured`, for sigma² = 1 and no field
  };
  /// Pairs that share their noise.
  struct NearPairs {
    double overlap = 0.0;  // sums over them, each once, of the share of a patch that is common,
    double weight = 0.0;   // w w,
    double product = 0.0;  // w w r·r
  };

  /// Sums over the pairs of J'J times w, w² and w³; of w² and w² r².
  struct PairSums {
    Matrix8 first = Matrix8::Zero();
    Matrix8 second = Matrix8::Zero();
    Matrix8 third = Matrix8::Zero();
    Slope slope = Slope::Zero();  // of w J
    double weights2 = 0.0;
    double squared_error = 0.0;
  };
  /// Sums over the cells; V: the slopes of a cell and of those that touch it.
  struct CellSums {
    Matrix8 spread = Matrix8::Zero();      // slope' smoothed: J'W K W J for tau² = 1
    Matrix8 single = Matrix8::Zero();      // slope2' smoothed
    Matrix8 near = Matrix8::Zero();        // weight V' smoothed
    Matrix8 near_noise = Matrix8::Zero();  // V' slope2
    Matrix8 fitted = Matrix8::Zero();      // V' slope
    double product = 0.0;   // of the errors of two cells that touch, or of one with itself
    double pairs = 0.0;     // w w of the pairs in them, each with itself too
    double expected = 0.0;  // of that, for tau² = 1 and without a fit
  };

  void choosePairs(const PointArrays<double>& pairs, const std::vector<double>& weights,
                   const Eigen::Matrix3d& homography);
  void limitErrors();
  void sortIntoCells(double cell_side);
  void smooth();
  NearPairs findNear(double side);
  PairSums sumPairs() const;
  CellSums sumCells() const;
  static void solve(const Moment& single, const Moment& near, double significance,
                    FieldFit& result);

  std::vector<Pair> pairs_;
  std::vector<double> squared_;  // errors, for their median
  std::vector<std::pair<double, std::size_t>> by_x_;
  std::vector<Cell> cells_;
  std::size_t columns_ = 0;
  std::size_t rows_ = 0;
  double step_ = 0.0;  // exp(-d/l) from cell to cell
};

}  // namespace ktgp_orb::homography
