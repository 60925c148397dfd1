#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "estimation/robust_fit.h"
#include "estimation/sandwich.h"
#include "two_view/cameras.h"
#include "two_view/epipolar.h"

namespace ktgp_orb::two_view {

/// A motion over a plane: K'^-1 H K ~ R + t n^T.
struct PlanarMotion {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;  ///< translation in units of the distance of the plane
  Eigen::Vector3d normal;       ///< unit vector

  RelativePose pose() const { return {rotation, translation.normalized()}; }
};

/// Up to two motions that `homography` allows (Faugeras & Lustman 1988; Malis & Vargas 2007) with
/// the plane in front of the camera for most pairs of `mask`; none if the camera did not move.
std::vector<PlanarMotion> planarMotions(const PointPairs& pairs,
                                        const std::vector<std::uint8_t>& mask,
                                        const Cameras& cameras, const Eigen::Matrix3d& homography);

/// Propagates `of_homography`, the covariance of the first eight entries, to the motion.
Covariance6 covarianceOf(const PlanarMotion& motion, const Cameras& cameras,
                         const Eigen::Matrix<double, 8, 8>& of_homography);

/// The covariance of a homography's first eight entries due to errors with standard deviation
/// `shared`, px, that vary linearly over the target points.
Eigen::Matrix<double, 8, 8> sharedCovariance(const PointPairs& pairs,
                                             const Eigen::Matrix3d& homography, double shared);

/// Reprojection errors of a camera that only turned, for estimation::RobustFit.
struct RotationProblem {
  using State = Eigen::Matrix3d;
  static constexpr int kResiduals = 2;
  static constexpr int kParameters = 3;

  const Cameras* cameras = nullptr;
  std::vector<Eigen::Vector3d> rays;     ///< rays of the reference points
  std::vector<Eigen::Vector2d> targets;  ///< px
  std::vector<double> precision;         ///< inverse relative deviations

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
  /// Fits the rotation, starting from `homography`, to the pairs near it. Returns false if these
  /// are fewer than half of the `inliers` of the homography. `deviations`: see TwoViewInput.
  bool fit(const PointPairs& pairs, const Cameras& cameras, const Eigen::Matrix3d& homography,
           std::size_t inliers, double max_error, const std::vector<double>* deviations);

  const Eigen::Matrix3d& rotation() const { return rotation_; }
  /// Covariance of small rotations about the target camera's axes, rad². It includes the noise;
  /// errors with standard deviation `shared`, px, that vary linearly over the image; and the effect
  /// of an undetected parallax of `unseen` px.
  Eigen::Matrix3d covariance(double shared, double unseen) const;
  /// Standard deviation of one coordinate, px.
  double scale() const { return fit_.weights().scale(); }
  std::size_t size() const { return problem_.targets.size(); }

 private:
  RotationProblem problem_;
  estimation::RobustFit<RotationProblem> fit_;
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
};

/// The turn that explains the best pairs without a translation: least squares with the weights of
/// the Cauchy distribution.
Eigen::Matrix3d turnOf(const EpipolarPairs& pairs);

}  // namespace ktgp_orb::two_view
