#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
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

/// The motions that explain `homography` (Faugeras & Lustman 1988; Malis & Vargas 2007), at most
/// two. The plane must be in front of the camera for at least half of the pairs in `mask`. Empty if
/// the camera did not move.
std::vector<PlanarMotion> planarMotions(const PointPairs& pairs,
                                        const std::vector<std::uint8_t>& mask,
                                        const Cameras& cameras, const Eigen::Matrix3d& homography);

/// Covariance of `motion`. `of_homography`: covariance of the homography's first eight entries.
Covariance6 covarianceOf(const PlanarMotion& motion, const Cameras& cameras,
                         const Eigen::Matrix<double, 8, 8>& of_homography);

/// The part of the covariance of a homography's first eight entries that shared errors cause, if
/// the homography is fitted to the pairs in `mask`.
Eigen::Matrix<double, 8, 8> sharedCovariance(const PointPairs& pairs,
                                             const std::vector<std::uint8_t>& mask,
                                             const Eigen::Matrix3d& homography,
                                             const SharedShifts& shared);

/// Reprojection errors of a camera that only turned, for estimation::RobustFit.
struct RotationProblem {
  using State = Eigen::Matrix3d;
  static constexpr int kResiduals = 2;
  static constexpr int kParameters = 3;

  const Cameras* cameras = nullptr;
  std::vector<Eigen::Vector3d> rays;     ///< rays of the reference points
  std::vector<Eigen::Vector2d> targets;  ///< px
  std::vector<double> precision;         ///< inverse of each pair's relative deviation

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

/// Fits the rotation by maximum likelihood. Keeps its buffers.
class RotationFit {
 public:
  /// Fits the rotation to the pairs that agree with it; starts from `homography`. Returns false if
  /// fewer than five pairs agree, or fewer than half of the homography's `inliers`, or if the
  /// agreeing pairs do not determine the rotation. `deviations`: see TwoViewInput.
  bool fit(const PointPairs& pairs, const Cameras& cameras, const Eigen::Matrix3d& homography,
           std::size_t inliers, double max_error, const std::vector<double>* deviations);

  const Eigen::Matrix3d& rotation() const { return rotation_; }
  /// Covariance of small rotations about the target camera's axes, rad². It includes the noise, the
  /// shared errors, and the effect of an undetected parallax of `unseen` px.
  Eigen::Matrix3d covariance(const SharedShifts& shared, double unseen) const;
  /// Standard deviation of one coordinate, px.
  double scale() const { return fit_.weights().scale(); }
  std::size_t size() const { return problem_.targets.size(); }

 private:
  RotationProblem problem_;
  estimation::RobustFit<RotationProblem> fit_;
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
};

/// The rotation that maps the reference rays of the best pairs to their target rays, as if the
/// camera had only turned: least squares with the weights of the Cauchy distribution.
Eigen::Matrix3d turnOf(const EpipolarPairs& pairs);

}  // namespace ktgp_orb::two_view
