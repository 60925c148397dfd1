#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "estimation/prosac.h"
#include "estimation/robust_fit.h"
#include "estimation/sandwich.h"
#include "homography/point_pairs.h"
#include "ktgp_orb/prosac_homography.h"
#include "two_view/cameras.h"
#include "two_view/shared_errors.h"
#include "two_view/solvers.h"

namespace ktgp_orb::two_view {

/// The epipolar geometry of two images: x'^T F x = 0 for the reference point x and the target point
/// x' of a pair, in normalised coordinates. With known cameras, the parameters describe the motion
/// (five degrees of freedom). Without cameras, they describe the factors of F = U diag(1, s, 0) V^T
/// (seven degrees of freedom).
struct Epipolar {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();  ///< F
  RelativePose motion;                               ///< the motion; only with cameras
  Eigen::Matrix3d u = Eigen::Matrix3d::Identity();   ///< U; only without cameras
  Eigen::Matrix3d v = Eigen::Matrix3d::Identity();   ///< V; only without cameras
  double s = 1.0;                                    ///< s; only without cameras
};

/// Point pairs in normalised coordinates, with one scale for both images. Converts between their
/// epipolar geometry and its parameters.
class EpipolarPairs : public homography::NormalisedPairs {
 public:
  /// `order`: order of the pairs, best quality first. `max_error`: limit of the Sampson distance of
  /// an inlier, px. `deviations`: see TwoViewInput.
  void load(const PointPairs& pairs, const estimation::QualityOrder& order, double max_error,
            const std::optional<Cameras>& cameras, const std::vector<double>* deviations = nullptr);

  std::vector<double> precision;  ///< inverse of each pair's relative standard deviation

  bool calibrated() const { return calibrated_; }
  /// Normalised units per px.
  double scale() const { return target.scale; }
  /// Focal length of the target camera, normalised units.
  double focal() const { return focal_; }
  /// The ray K^-1 x, where x is the reference point of pair `i`, px; without cameras, its
  /// normalised point.
  Eigen::Vector3d referenceRay(std::size_t i) const {
    return reference_ray_ * Eigen::Vector3d(refinement.x[i], refinement.y[i], 1.0);
  }
  Eigen::Vector3d targetRay(std::size_t i) const {
    return target_ray_ * Eigen::Vector3d(refinement.u[i], refinement.v[i], 1.0);
  }

  /// Degrees of freedom, and number of pairs in a sample: 5 with cameras, 7 without.
  Eigen::Index freedom() const { return calibrated_ ? 5 : 7; }
  Epipolar fromMotion(const RelativePose& motion) const;
  Epipolar fromMatrix(const Eigen::Matrix3d& normalised) const;
  /// F for pixel coordinates, scaled to norm 1.
  Eigen::Matrix3d inPixels(const Epipolar& geometry) const;

  /// Jacobian of F's entries, row by row, with respect to the parameters. With cameras: rotations
  /// about the target camera's axes (3), then changes of the translation t in two directions
  /// orthogonal to it (2). Without cameras: rotations of U (3) and V (3), then s.
  using Tangent = Eigen::Matrix<double, 9, Eigen::Dynamic, 0, 9, 7>;
  Tangent tangent(const Epipolar& geometry) const;
  Epipolar moved(const Epipolar& geometry, const estimation::Step& step) const;

  /// Error of a pair with respect to the motion, normalised units. If the point is in front of both
  /// cameras, this is the Sampson distance. If not, the scene point that fits best is at infinity;
  /// then this is the distance of the target point from the image of that point, divided by sqrt(2)
  /// because both images have errors.
  double distance(const Epipolar& geometry, std::size_t i) const;

 private:
  /// Returns F for normalised coordinates, computed from an essential matrix.
  Eigen::Matrix3d fundamentalOf(const Eigen::Matrix3d& essential) const {
    return target_ray_.transpose() * essential * reference_ray_;
  }

  bool calibrated_ = false;
  double focal_ = 1.0;
  Eigen::Matrix3d reference_ray_;  // converts normalised coordinates to a ray
  Eigen::Matrix3d target_ray_;
};

/// Returns two unit vectors that are orthogonal to each other and to the unit vector `direction`.
Eigen::Matrix<double, 3, 2> across(const Eigen::Vector3d& direction);

/// Returns `matrix`, multiplied from the left by the rotation with the rotation vector `rotation`,
/// rad.
Eigen::Matrix3d turned(const Eigen::Vector3d& rotation, const Eigen::Matrix3d& matrix);

using Vector9 = Eigen::Matrix<double, 9, 1>;

/// The problem that estimation::RobustFit solves. The residuals are the Sampson distances of the
/// selected pairs, divided by the relative standard deviations of the pairs.
struct SampsonProblem {
  using State = Epipolar;

  const EpipolarPairs* pairs = nullptr;
  homography::PointArrays<double> points;  ///< the selected pairs
  std::vector<double> precision;           ///< precision of each selected pair

  Epipolar moved(const Epipolar& geometry, const estimation::Step& step) const {
    return pairs->moved(geometry, step);
  }
  void linearise(const Epipolar& geometry, estimation::RobustWeights& weights,
                 estimation::NormalEquations& sums) const;
  /// Returns the residual of the selected pair `i`. Sets `by_entries` to the derivatives of the
  /// residual with respect to the nine entries of F, row by row, and `by_points`, unless it is
  /// null, to the derivatives with respect to the reference point (2) and the target point (2).
  double evaluate(std::size_t i, const Eigen::Matrix3d& f, double* by_entries,
                  Eigen::RowVector4d* by_points) const;
};

/// Fits an epipolar geometry by maximum likelihood, on the manifold of Epipolar. The Sampson
/// distances are assumed to have Student's t distribution. Reuses its buffers from call to call.
class EpipolarFit {
 public:
  /// Keeps a pointer to `pairs`, which must be sorted by quality, best first.
  void setPairs(const EpipolarPairs& pairs) { problem_.pairs = &pairs; }

  /// Makes one step with the best pairs whose error is below `reach`. Returns false if there are
  /// not more such pairs than a sample has, or if they do not determine the step.
  bool step(double reach, Epipolar& geometry);

  /// Fits to convergence, with all pairs whose error is below twice the limit, and estimates the
  /// scale of the errors. Returns false if the pairs do not determine the geometry.
  bool minimise(Epipolar& geometry);

  /// Covariance of the parameters after minimise(), without the errors that all pairs share. Errors
  /// of pairs in the same cell may be correlated (Liang & Zeger, Biometrika 1986). `cell`: side of
  /// a cell, normalised units. The covariance is not finite if the pairs do not determine the
  /// parameters.
  estimation::Information covariance(const Epipolar& geometry, double cell);

  /// How far one standard deviation of each shared error moves the parameters, to first order;
  /// after minimise(). The covariance that the shared errors add is the sum of the squares of the
  /// columns.
  using SharedSteps =
      Eigen::Matrix<double, Eigen::Dynamic, SharedShifts::kErrors, 0, 7, SharedShifts::kErrors>;
  SharedSteps sharedSteps(const Epipolar& geometry, const SharedShifts& shared) const;

  /// Returns a factor for `covariance`. It is above 1 if the motion changes more than `covariance`
  /// predicts when the fit leaves out a part of the image. Changes the state that minimise() left.
  double instability(const Epipolar& geometry, double cell, const Covariance6& covariance);

  /// Scale of the Sampson distances, normalised units, for a pair whose relative standard deviation
  /// is 1. minimise() estimates it.
  double scale() const { return fit_.weights().scale(); }

 private:
  std::size_t select(const Epipolar& geometry, double reach, std::size_t most);

  SampsonProblem problem_;
  estimation::RobustFit<SampsonProblem> fit_;
  std::vector<std::uint8_t> near_;
  std::vector<std::uint8_t> used_;
  std::vector<std::size_t> cell_;  // cell of each selected pair
  estimation::ClusteredMeat clusters_;
  std::vector<int> group_;  // group of each pair, for the jackknife
  int left_out_ = -1;       // group that select() leaves out; -1: none
};

/// The larger of two angles, rad: between the translations, and between the rotations.
double apart(const RelativePose& a, const RelativePose& b);

/// Sum of the squared Sampson distances, each at most limit². Stops when the sum exceeds `give_up`.
float costOf(const EpipolarPairs& pairs, const Epipolar& model, float give_up);

/// Provides estimation::ProsacSearch with the models of a sample, their costs and refining steps.
class EpipolarProblem {
 public:
  using Model = Epipolar;

  /// Keeps a pointer to `pairs`, which must be sorted by quality, best first.
  void setPairs(const EpipolarPairs& pairs) {
    pairs_ = &pairs;
    fit_.setPairs(pairs);
    tried_.clear();
  }
  std::size_t size() const { return pairs_->size(); }
  std::size_t sampleSize() const { return static_cast<std::size_t>(pairs_->freedom()); }
  template <typename Visit>
  void solve(const estimation::ProsacSample& sample, Visit visit) {
    solve(sample);
    for (const Epipolar& model : models_) visit(model);
  }
  float cost(const Epipolar& model, float give_up) const { return costOf(*pairs_, model, give_up); }
  bool refine(double widening, Epipolar& model) {
    return fit_.step(widening * pairs_->limit, model);
  }
  std::size_t findInliers(const Epipolar& model, std::vector<std::uint8_t>& inlier) const;
  /// The best motions among the solutions of the samples since setPairs() that clearly differ from
  /// `best` and from each other. The search keeps only the best motion, and if all points lie on a
  /// few straight edges, another motion may fit as well. Valid until the next call.
  const std::vector<Epipolar>& rivalsOf(const Epipolar& best);

 private:
  void solve(const estimation::ProsacSample& sample);

  const EpipolarPairs* pairs_ = nullptr;
  EpipolarFit fit_;
  std::vector<Eigen::Matrix3d> solutions_;  // essential or fundamental matrices of a sample
  std::vector<Epipolar> models_;
  std::vector<Epipolar> tried_;  // solutions of the samples, if K is known
  // buffers of rivalsOf(): cost and place in `tried_`, and the result
  std::vector<std::pair<float, std::size_t>> scored_;
  std::vector<Epipolar> rivals_;
};

}  // namespace ktgp_orb::two_view
