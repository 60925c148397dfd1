#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/homography/point_pairs.h"
#include "core/prosac/prosac.h"
#include "core/two_view/cameras.h"
#include "core/two_view/solvers.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::two_view {

/// The epipolar geometry of two images, with x'^T F x = 0 between normalised coordinates. With
/// known cameras the motion is the parameter (five degrees of freedom), without them the factors of
/// F = U diag(1, s, 0) V^T (seven).
struct Epipolar {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();  ///< F
  RelativePose motion;                               ///< with cameras
  Eigen::Matrix3d u = Eigen::Matrix3d::Identity();   ///< without
  Eigen::Matrix3d v = Eigen::Matrix3d::Identity();
  double s = 1.0;
};

/// Point pairs for the estimation: centred, and scaled alike in both images, so that distances
/// in the two can be compared.
class EpipolarPairs {
 public:
  /// `max_error`: limit of the Sampson distance of an inlier, px; best quality first by `order`.
  void load(const PointPairs& pairs, const prosac::QualityOrder& order, double max_error,
            const std::optional<Cameras>& cameras);

  std::size_t size() const { return scoring.size; }
  bool calibrated() const { return calibrated_; }
  double scale() const { return scale_; }
  double limit() const { return limit_; }
  /// Focal length of the target camera, normalised units.
  double focal() const { return focal_; }
  /// The ray K^-1 x of a pair; the normalised point itself without cameras.
  Eigen::Vector3d referenceRay(std::size_t i) const;
  Eigen::Vector3d targetRay(std::size_t i) const;

  /// Degrees of freedom: 5 with cameras, 7 without.
  Eigen::Index freedom() const { return calibrated_ ? 5 : 7; }
  Epipolar fromMotion(const RelativePose& motion) const;
  Epipolar fromMatrix(const Eigen::Matrix3d& normalised) const;
  /// F between pixels, of norm 1.
  Eigen::Matrix3d inPixels(const Epipolar& geometry) const;

  /// Derivative of F's entries, row by row, by the parameters: with cameras, rotation about the
  /// target camera's axes and two directions across t; without, the rotations of U and V, and s.
  using Tangent = Eigen::Matrix<double, 9, Eigen::Dynamic, 0, 9, 7>;
  Tangent tangent(const Epipolar& geometry) const;
  /// The geometry after a step of the parameters.
  using Step = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 7, 1>;
  Epipolar moved(const Epipolar& geometry, const Step& step) const;

  homography::PointArrays<float> scoring;
  homography::PointArrays<double> refinement;

 private:
  Eigen::Matrix3d by_motion(const Eigen::Matrix3d& essential) const;

  bool calibrated_ = false;
  double scale_ = 1.0;  // normalised units a px
  double limit_ = 0.0;
  double focal_ = 1.0;
  Eigen::Matrix3d reference_from_pixel_;
  Eigen::Matrix3d target_from_pixel_;
  Eigen::Matrix3d reference_ray_;  // normalised -> ray
  Eigen::Matrix3d target_ray_;
};

/// Two directions across a unit vector.
Eigen::Matrix<double, 3, 2> across(const Eigen::Vector3d& direction);

/// Turns by a small rotation vector.
Eigen::Matrix3d turned(const Eigen::Vector3d& rotation, const Eigen::Matrix3d& matrix);

/// Maximum likelihood for Sampson distances with Student's t distribution of four degrees of
/// freedom, as MEstimator does it for homographies. Works on the manifold of Epipolar. Keeps its
/// buffers.
class EpipolarFit {
 public:
  using Matrix9 = Eigen::Matrix<double, 9, 9>;
  using Vector9 = Eigen::Matrix<double, 9, 1>;
  using Information = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 7, 7>;

  /// One step over the first `most` pairs within `reach`, with the scale of the errors given; both
  /// in normalised units. False where these are not more than `fewest`, or do not determine it.
  bool step(const EpipolarPairs& pairs, double reach, double scale, std::size_t fewest,
            std::size_t most, Epipolar& geometry);

  /// To convergence, over all pairs within twice the limit; the scale of the errors is estimated,
  /// too. False where the pairs do not determine the geometry.
  bool minimise(const EpipolarPairs& pairs, Epipolar& geometry);

  /// After minimise(): of the parameters. Errors of pairs in one of the cells, `cell` normalised
  /// units wide, may be correlated (Liang & Zeger, Biometrika 1986). `shared`: standard deviation
  /// of errors that vary linearly over the image, normalised units.
  Information covariance(const EpipolarPairs& pairs, const Epipolar& geometry, double cell,
                         double shared);

  /// After minimise(): scale of the Sampson distances, normalised units.
  double scale() const { return scale_; }

 private:
  struct Sums {
    Matrix9 squares = Matrix9::Zero();   // of J^T w J, J by F's entries
    Vector9 gradient = Vector9::Zero();  // of J^T w e
    double weight = 0.0;                 // of w
    double cost = 0.0;                   // of w e²
    double former_cost = 0.0;
    double derivative = 0.0;  // of d(w e)/de
  };

  std::size_t select(const EpipolarPairs& pairs, const Epipolar& geometry, double reach,
                     std::size_t most);
  static bool isBehind(const EpipolarPairs& pairs, const RelativePose& motion, std::size_t i);
  void reweight(const Epipolar& geometry, Sums& sums);
  void estimateScale(double freedom);
  bool findStep(const EpipolarPairs& pairs, const Epipolar& geometry, const Sums& sums,
                double damping, EpipolarPairs::Step& step) const;

  std::vector<std::uint8_t> near_;
  std::vector<std::uint8_t> used_;
  homography::PointArrays<double> selected_;
  std::vector<double> error_;
  std::vector<double> weight_;
  std::vector<double> former_weight_;
  double scale_ = 0.0;
  Sums sums_;
  std::vector<Vector9> cells_;  // sums of J^T w e
};

/// Number of pairs whose Sampson distance is below `limit`; `inlier` has a 1 for each.
std::size_t findInliers(const EpipolarPairs& pairs, const Eigen::Matrix3d& matrix, double limit,
                        std::vector<std::uint8_t>& inlier);

/// Epipolar geometry as prosac::ProsacSearch looks for it: five pairs with cameras, seven without.
template <std::size_t Sample>
class EpipolarProblem {
 public:
  using Model = Epipolar;
  static constexpr std::size_t kSample = Sample;

  void setPairs(const EpipolarPairs& pairs) { pairs_ = &pairs; }
  std::size_t size() const { return pairs_->size(); }
  template <typename Visit>
  void solve(const prosac::ProsacSample& sample, Visit visit) {
    solve(sample);
    for (const Epipolar& model : models_) visit(model);
  }
  float cost(const Epipolar& model, float give_up) const;
  bool refine(double widening, Epipolar& model) {
    constexpr std::size_t kEnough = 200;  // best pairs
    constexpr double kScales = 3.0;       // of the errors within the limit
    const double reach = widening * pairs_->limit();
    return fit_.step(*pairs_, reach, reach / kScales, kSample, kEnough, model);
  }
  std::size_t findInliers(const Epipolar& model, std::vector<std::uint8_t>& inlier) const {
    return two_view::findInliers(*pairs_, model.matrix, pairs_->limit(), inlier);
  }

 private:
  void solve(const prosac::ProsacSample& sample);

  const EpipolarPairs* pairs_ = nullptr;
  std::vector<Eigen::Matrix3d> solutions_;
  std::vector<Epipolar> models_;
  EpipolarFit fit_;
};

}  // namespace ktgp_orb::two_view
