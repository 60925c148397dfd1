#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <optional>

#include "ktgp_orb/two_view.h"
#include "two_view/solvers.h"

namespace ktgp_orb::two_view {

/// The camera matrices K of both cameras, px, and their inverses.
struct Cameras {
  Eigen::Matrix3d reference;
  Eigen::Matrix3d target;
  Eigen::Matrix3d reference_inverse;
  Eigen::Matrix3d target_inverse;

  Cameras(const Eigen::Matrix3d& of_reference, const Eigen::Matrix3d& of_target)
      : reference(of_reference),
        target(of_target),
        reference_inverse(of_reference.inverse()),
        target_inverse(of_target.inverse()) {}

  Eigen::Vector3d referenceRay(const Eigen::Vector2d& x) const {
    return reference_inverse * x.homogeneous();
  }
  Eigen::Vector3d targetRay(const Eigen::Vector2d& u) const {
    return target_inverse * u.homogeneous();
  }
  Eigen::Matrix3d homographyOf(const Eigen::Matrix3d& rotation) const {
    return target * rotation * reference_inverse;
  }
  Eigen::Matrix3d fundamentalOf(const RelativePose& motion) const {
    return target_inverse.transpose() * crossed(motion.translation) * motion.rotation *
           reference_inverse;
  }
  /// Returns true if the scene point of a pair is in front of both cameras, or so far away that its
  /// rays are parallel within `max_error`, px.
  bool seeInFront(const RelativePose& motion, const Eigen::Vector2d& reference,
                  const Eigen::Vector2d& target, double max_error) const;
};

/// Returns true if the result contains a motion. If the geometry is a rotation, the translation is
/// zero.
inline bool hasPose(const TwoView& view) {
  return view.geometry == Geometry::rotation || !view.pose.translation.isZero(0.0);
}

/// The cameras of `input`; empty if K is not given. Throws like TwoViewEstimator::estimate.
std::optional<Cameras> camerasOf(const TwoViewInput& input);

/// Distance of the target point `u` from the epipolar line of the reference point `x`, px. `f`:
/// fundamental matrix for positions in px.
double distanceToLine(const Eigen::Matrix3d& f, const Eigen::Vector2d& x, const Eigen::Vector2d& u);
/// Sampson distance of the pair (x, u), px. It is approximately sqrt(|dx|² + |du|²), where dx and
/// du are the smallest shifts of the two points that make the pair agree with `f` exactly.
double sampson(const Eigen::Matrix3d& f, const Eigen::Vector2d& x, const Eigen::Vector2d& u);

/// Limit of the Sampson distance, as a share of the limit of the reprojection error.
constexpr double kSampsonShare = 0.5;

/// Sets mask, inliers and RMSE of `view` from its geometry, which may be of any kind. `max_error`:
/// see TwoViewOptions::max_error.
void label(const PointPairs& pairs, const std::optional<Cameras>& cameras, double max_error,
           TwoView& view);

/// Median, over the inliers, of the angle between the two rays of a pair, degrees. `angles`:
/// buffer.
double parallaxOf(const PointPairs& pairs, const Cameras& cameras, const TwoView& view,
                  std::vector<double>& angles);

/// Pose covariance from `of_step`, the covariance of small rotations and of changes of the
/// translation in the two directions orthogonal to it (see across()).
Covariance6 poseCovariance(const Eigen::Matrix<double, 5, 5>& of_step,
                           const Eigen::Vector3d& translation);

/// The step from one motion to another, in the coordinates of TwoView::pose_covariance. Its
/// translation is orthogonal to from.translation and as long as the arc between the translations.
Eigen::Matrix<double, 6, 1> stepBetween(const RelativePose& from, const RelativePose& to);

}  // namespace ktgp_orb::two_view
