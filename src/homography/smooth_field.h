#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "homography/point_pairs.h"

namespace ktgp_orb::homography {

/// Number of cells along the image's diagonal. The pairs in one cell may have a common error.
inline constexpr double kCellsAlongDiagonal = 16.0;

/// Settings for the estimation of the smooth field; lengths are in units of the reference points.
struct FieldScales {
  double image_diagonal = 0.0;
  /// A field is assumed only if its estimate exceeds this multiple of the standard deviation that
  /// the estimate has if there is only noise.
  double significance = 0.0;
  /// Two pairs may share noise if they are closer than this, both in x and in y.
  double nearby = 0.0;
  /// Distance over which the displacement between the images changes by a pixel.
  double rounding_length = 0.0;
};

/// Result of SmoothField::fit: the errors of the pairs, split into a smooth field and noise.
struct FieldFit {
  double variance = 0.0;  ///< variance tau² of the field per coordinate, in squared target units
  double noise_share = 1.0;  ///< share of the squared errors that is due to noise, 0..1
  /// Variance of the noise per coordinate, in the units of `variance`; 0 if there are too few
  /// pairs.
  double noise_variance = 0.0;
  /// Covariance of H's first eight entries that comes from the field alone.
  Eigen::Matrix<double, 8, 8> covariance = Eigen::Matrix<double, 8, 8>::Zero();
  /// Covariance of H from rounding errors of variance 1 (see SmoothField).
  Eigen::Matrix<double, 8, 8> of_rounding = Eigen::Matrix<double, 8, 8>::Zero();
  /// Covariance of H caused by an error that is the same for all pairs. Its variance is taken as 2
  /// % of the variance of the noise. Interpolation causes such an error in sub-pixel registration:
  /// it is the same for all patches at the same position between pixels (Schreier, Braasch &
  /// Sutton, Optical Engineering 39, 2000).
  Eigen::Matrix<double, 8, 8> common_covariance = Eigen::Matrix<double, 8, 8>::Zero();
  /// Factor, >= 1, by which the variance of the mean error is larger than for independent errors.
  /// It is needed for pairs found by patches of side FieldScales::nearby: if two patches overlap,
  /// their errors are correlated in proportion to the overlap.
  double shared_patches = 1.0;
};

/// Separates a smooth field from noise in the reprojection errors of an estimated homography.
///
/// In real scenes neighbouring points have similar errors: the scene is not quite a plane, the lens
/// has distortion, or the camera has a rolling shutter. Such errors do not average out if more
/// pairs are used, and a covariance that assumes independent errors is several times too small. Our
/// model for the covariance of the errors of two pairs, in each coordinate, is
///
///   K = tau² exp(-d/l) + sigma² (d = 0).
///
/// tau² is the variance of the field, sigma² the variance of the noise (only for a pair with
/// itself), d = |dx| + |dy| the distance in the reference image, and l = 0.6 of the image's
/// diagonal. tau² and sigma² are chosen so that two sums equal their expectations: the sum of the
/// squared errors, and the sum of the products of the errors of near pairs. The expectations take
/// into account that fitting eight entries made the residuals r smaller: E[r r'] = M K M' with
/// M = I - J A^-1 J'W and A = J'WJ. Here J is the Jacobian of the fit, W contains the weights, and
/// ' is the transpose. Then cov(H) = A^-1 J'W K W J A^-1 (White 1980; Conley 1999; Bell & McCaffrey
/// 2002). The errors are summed over cells with a side of a 16th of the diagonal; near pairs are in
/// the same or in adjacent cells, and the field is taken as constant within a cell. Products of two
/// pairs that may share noise (FieldScales::nearby) are left out.
///
/// Positions are rounded; keypoints, for example, lie on whole pixels. The rounding error of a
/// displacement depends on the fractional part of the displacement in px. So neighbouring pairs
/// have similar rounding errors, and the residuals do not show these errors: if the image moves by
/// a fifth of a pixel, nearly all keypoints stay on the same pixel. Rounding errors are treated as
/// a field with known variance and the same covariance model, in which l is the distance over which
/// the displacement changes by a pixel. If this distance is short, rounding errors average out.
/// Reuses its buffers from call to call.
class SmoothField {
 public:
  /// Splits the errors of `homography` into field and noise. `weights`: weights of the pairs in the
  /// fit of H; `curvature`: the second derivative of the likelihood divided by J'WJ, 1 for least
  /// squares. Uses at most 300 pairs, spread over the list.
  FieldFit fit(const PointArrays<double>& pairs, const std::vector<double>& weights,
               double curvature, const Eigen::Matrix3d& homography, const FieldScales& scales);

 private:
  using Matrix8 = Eigen::Matrix<double, 8, 8>;
  /// The different entries of a pair's Jacobian: x y z, u x, u y, v x, v y (see
  /// reprojection_fit.cpp). The eighth entry is always zero; it is there because Eigen has vector
  /// code for eight doubles, but not for seven.
  using Slope = Eigen::Matrix<double, 8, 1>;

  struct Pair {
    Slope slope;
    Eigen::Vector2d point, error;
    double weight = 0.0;  ///< weight w in the fit, 1 on average
    std::size_t cell = 0;
  };
  struct Cell {
    double weight = 0.0;                              // sum of w over the pairs of the cell
    Eigen::Vector2d error = Eigen::Vector2d::Zero();  // sum of w r, where r is a pair's error
    Slope slope = Slope::Zero();                      // sum of w J, where J is a pair's slope
    Slope slope2 = Slope::Zero();                     // sum of w² J
    Slope smoothed = Slope::Zero();  // sum of exp(-d/l) times `slope` over all cells
  };
  /// A statistic of the errors, its expectation for a field with tau² = 1, and its expectation for
  /// noise with sigma² = 1.
  struct Moment {
    double measured = 0.0;
    double of_field = 0.0;
    double of_noise = 0.0;
    // Standard deviation of `measured` for noise with sigma² = 1 and no field.
    double deviation = 0.0;
  };
  /// Sums over all pairs, with weight w, Jacobian J and error r: of w J'J (`first`), w² J'J
  /// (`second`), w³ J'J (`third`), w J (`slope`), w² (`weights2`) and w² |r|² (`squared_error`).
  struct PairSums {
    Matrix8 first = Matrix8::Zero();
    Matrix8 second = Matrix8::Zero();
    Matrix8 third = Matrix8::Zero();
    Slope slope = Slope::Zero();
    double weights2 = 0.0;
    double squared_error = 0.0;
    // If the patches of two point pairs overlap, the two pairs share noise. These are sums over all
    // such combinations of two pairs, with weights w, w' and errors r, r'. near_overlap: share of
    // the patch area that overlaps; near_weight: w w'; near_product: w w' r·r'.
    double near_overlap = 0.0;
    double near_weight = 0.0;
    double near_product = 0.0;
  };
  /// Sums of products over all cells. The comment beside each sum says which product: `weight`,
  /// `slope`, `slope2` and `smoothed` are the fields of Cell, V is the sum of `slope` over the cell
  /// and the cells that touch it, and ' is the transpose.
  struct CellSums {
    Matrix8 spread = Matrix8::Zero();      // slope smoothed'; the sum is J'W K W J for tau² = 1
    Matrix8 single = Matrix8::Zero();      // slope2 smoothed'
    Matrix8 near = Matrix8::Zero();        // weight V smoothed'
    Matrix8 near_noise = Matrix8::Zero();  // V slope2'
    Matrix8 fitted = Matrix8::Zero();      // V slope'
    // Sum of the products of a cell's error with the errors of the cell itself and of each cell
    // that touches it.
    double product = 0.0;
    // Sum of the products of a cell's weight with the weights of the cell itself and of each cell
    // that touches it.
    double pairs = 0.0;
    // Expectation of `product` for a field with tau² = 1, before H is fitted.
    double expected = 0.0;
  };

  /// `inverse`: A^-1, see SmoothField. `by_field`, `by_noise`: the covariance of H,
  /// A^-1 J'W K W J A^-1, for a field with tau² = 1 and for noise with sigma² = 1.
  struct Fitted {
    Matrix8 inverse;
    Matrix8 by_field;
    Matrix8 by_noise;
  };

  void choosePairs(const PointArrays<double>& pairs, const std::vector<double>& weights,
                   const Eigen::Matrix3d& homography);
  void limitErrors();
  void sortIntoCells(double cell_side);
  void smooth();
  void sumNear(double side, PairSums& sums);
  PairSums sumPairs() const;
  CellSums sumCells() const;
  Matrix8 spreadOfRounding(double length, double cell_side);
  static Moment singleMoment(const PairSums& of_pairs, const CellSums& of_cells,
                             const Fitted& fitted);
  static Moment nearMoment(const PairSums& of_pairs, const CellSums& of_cells, const Fitted& fitted,
                           const Moment& single);
  static void setCovariances(const PairSums& of_pairs, const Fitted& fitted, const Moment& single,
                             FieldFit& result);
  static void solve(const Moment& single, const Moment& near, double significance,
                    FieldFit& result);

  std::vector<Pair> pairs_;
  std::vector<double> squared_;  // buffer for the squared errors, whose median is computed
  std::vector<std::pair<double, std::size_t>> by_x_;
  std::vector<Cell> cells_;
  std::size_t columns_ = 0;
  std::size_t rows_ = 0;
  double step_ = 0.0;  // exp(-d/l) for adjacent cells
};

}  // namespace ktgp_orb::homography
