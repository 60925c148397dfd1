#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "estimation/robust_fit.h"
#include "estimation/sandwich.h"
#include "two_view/cameras.h"
#include "two_view/epipolar.h"
#include "two_view/shared_errors.h"

namespace ktgp_orb::two_view {

/// A motion that explains the homography H of a plane: K'^-1 H K ~ R + t n^T, with the matrices K
/// and K' of the reference and the target camera, the rotation R, the translation t and the plane's
/// normal n.
struct PlanarMotion {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;  ///< translation, in units of the plane's distance
  Eigen::Vector3d normal;       ///< unit vector

  RelativePose pose() const { return {rotation, translation.normalized()}; }
};

/// Returns the motions, at most two, that explain `homography` (Faugeras & Lustman 1988; Malis &
/// Vargas 2007). Leaves out a motion if the plane would be behind the camera for more than half of
/// the pairs in `mask`. Empty if the camera did not move.
std::vector<PlanarMotion> planarMotions(const PointPairs& pairs,
                                        const std::vector<std::uint8_t>& mask,
                                        const Cameras& cameras, const Eigen::Matrix3d& homography);

/// Returns the covariance of `motion`. `of_homography`: covariance of the homography's first eight
/// entries.
Covariance6 covarianceOf(const PlanarMotion& motion, const Cameras& cameras,
                         const Eigen::Matrix<double, 8, 8>& of_homography);

/// Returns how far one standard deviation of each shared error changes the first eight entries of a
/// homography that was fitted to the pairs in `mask`.
SharedShifts::Columns<8> sharedChanges(const PointPairs& pairs,
                                       const std::vector<std::uint8_t>& mask,
                                       const Eigen::Matrix3d& homography,
                                       const SharedShifts& shared);

/// Returns `homography`, scaled so that its last entry is 1, with `change` added to its first eight
/// entries.
Eigen::Matrix3d changed(const Eigen::Matrix3d& homography,
                        const Eigen::Matrix<double, 8, 1>& change);

/// The rotation whose homography is nearest to a given homography.
struct NearestTurn {
  Eigen::Matrix3d rotation;
  Eigen::Matrix3d covariance;  ///< of small rotations about the target camera's axes, rad²
  double distance2 = 0.0;      ///< squared Mahalanobis distance of the homographies, to first order
};

/// `covariance`: covariance of the first eight entries of `homography`; `start`: a rotation near
/// the nearest one. Empty if the covariance is singular.
std::optional<NearestTurn> nearestTurn(const Eigen::Matrix3d& homography,
                                       const Eigen::Matrix<double, 8, 8>& covariance,
                                       const Cameras& cameras, const Eigen::Matrix3d& start);

/// How far the camera may have turned about its optical axis unnoticed, rad. A motion t sideways
/// over a plane with the tilt n, both in units of its distance, changes the image near the axis by
/// t n^T: by a turn of (t x n) / 2 and by a shear that is not smaller. A fitted rotation follows
/// the turn; the homography shows the shear. `rotation`: the rotation of the camera.
double shearOf(const Eigen::Matrix3d& homography, const Cameras& cameras,
               const Eigen::Matrix3d& rotation);

/// How far the camera may have moved sideways over a plane that faces it, besides turning: the root
/// mean square along an axis, in units of the distance to the plane. Such a motion hardly differs
/// from a rotation if the field of view is small. `rotation`: the rotation of the camera; the other
/// arguments are as for nearestTurn(). Empty if the covariance is singular.
std::optional<double> sidewaysOf(const Eigen::Matrix3d& homography,
                                 const Eigen::Matrix<double, 8, 8>& covariance,
                                 const Cameras& cameras, const Eigen::Matrix3d& rotation);

/// The problem that estimation::RobustFit solves: find the rotation of a camera that only turned.
/// The residuals are reprojection errors.
struct RotationProblem {
  using State = Eigen::Matrix3d;
  static constexpr int kResiduals = 2;
  static constexpr int kParameters = 3;

  const Cameras* cameras = nullptr;
  std::vector<Eigen::Vector3d> rays;     ///< rays of the reference points
  std::vector<Eigen::Vector2d> targets;  ///< px
  std::vector<double> precision;         ///< inverse of each pair's relative standard deviation

  static State moved(const State& rotation, const estimation::Step& step) {
    return turned(step.head<3>(), rotation);
  }
  void evaluate(std::size_t i, const State& rotation, Eigen::Vector2d& residual,
                Eigen::Matrix<double, 2, 3>& jacobian) const;
  void linearise(const State& rotation, estimation::RobustWeights& weights,
                 estimation::NormalEquations& sums) const {
    estimation::lineariseEach(*this, rotation, weights, sums);
  }
};

/// Fits the rotation of a camera that only turned, by maximum likelihood. Reuses its buffers from
/// call to call.
class RotationFit {
 public:
  /// Fits the rotation to the pairs that agree with it; starts from `homography`. Returns false if
  /// fewer than five pairs agree, or fewer than half as many as the homography has (`inliers`), or
  /// if the agreeing pairs do not determine the rotation. `max_error`: see TwoViewOptions.
  /// `deviations`: see TwoViewInput.
  bool fit(const PointPairs& pairs, const Cameras& cameras, const Eigen::Matrix3d& homography,
           std::size_t inliers, double max_error, const std::vector<double>* deviations);

  const Eigen::Matrix3d& rotation() const { return rotation_; }
  /// Covariance of small rotations about the target camera's axes, rad². It includes the noise, the
  /// shared errors, and an undetected parallax that shifts all points alike, with the standard
  /// deviation `unseen` (px) along x and y.
  Eigen::Matrix3d covariance(const SharedShifts& shared, double unseen) const;
  /// Standard deviation of one coordinate of the reprojection errors, px.
  double scale() const { return fit_.weights().scale(); }
  std::size_t size() const { return problem_.targets.size(); }

 private:
  RotationProblem problem_;
  estimation::RobustFit<RotationProblem> fit_;
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
};

/// Returns the motion that explains nearly the same pairs as `geometry` if the scene is shallow
/// compared with its distance: perspective hardly shows, so a scene and its mirror image in depth,
/// seen by a camera that moves to the other side, look alike (Necker's cube). Empty if the rays of
/// the agreeing pairs are parallel.
std::optional<RelativePose> reversedInDepth(const EpipolarPairs& pairs, const Epipolar& geometry);

/// Returns the rotation that maps the reference rays of the best pairs to their target rays, as if
/// the camera had only turned. This is a least-squares fit with the weights of the Cauchy
/// distribution.
Eigen::Matrix3d turnOf(const EpipolarPairs& pairs);

}  // namespace ktgp_orb::two_view
