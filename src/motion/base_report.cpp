#include "motion/base_report.h"

#include "core/util/small_matrix.h"

namespace ktgp_orb::motion {
namespace {

using util::propagated;

void reportPose(const CameraMotion& camera, const Eigen::Vector3d& origin,
                const GroundMotionOptions& options, GroundEstimate& estimate) {
  const Eigen::Matrix3d& axes = camera.pose.axes;
  const Pose3 base_to_camera = options.camera_to_base.inverse();
  const Eigen::Vector3d lever = base_to_camera.translation();
  estimate.height = camera.pose.position.z();
  estimate.base_to_odometry.linear() = axes * base_to_camera.linear();
  estimate.base_to_odometry.translation() = camera.pose.position + axes * lever;
  Matrix6 slope = Matrix6::Identity();
  slope.topRightCorner<3, 3>() = -axes * cross(lever);
  slope.bottomRightCorner<3, 3>() = axes;
  const double scale_variance = options.scale_deviation * options.scale_deviation;
  const Eigen::Vector3d way = estimate.base_to_odometry.translation() - origin;
  estimate.pose_covariance = propagated(slope, camera.covariance);
  estimate.pose_covariance.topLeftCorner<3, 3>() += scale_variance * way * way.transpose();
}

void reportTwist(const CameraMotion& camera, const GroundMotionOptions& options,
                 GroundEstimate& estimate) {
  const Eigen::Matrix3d to_base = options.camera_to_base.linear();
  const Eigen::Vector3d lever = options.camera_to_base.inverse().translation();
  Matrix6 slope = Matrix6::Zero();
  slope.topLeftCorner<3, 3>() = to_base;
  slope.topRightCorner<3, 3>() = -to_base * cross(lever);
  slope.bottomRightCorner<3, 3>() = to_base;
  const double scale_variance = options.scale_deviation * options.scale_deviation;
  estimate.twist = slope * camera.twist;
  const Eigen::Vector3d velocity = estimate.twist.head<3>();
  estimate.twist_covariance = propagated(slope, camera.twist_covariance);
  estimate.twist_covariance.topLeftCorner<3, 3>() +=
      scale_variance * velocity * velocity.transpose();
}

}  // namespace

void reportBase(const CameraMotion& camera, const Eigen::Vector3d& origin,
                const GroundMotionOptions& options, GroundEstimate& estimate) {
  reportPose(camera, origin, options, estimate);
  if (estimate.hasTwist()) reportTwist(camera, options, estimate);
}

}  // namespace ktgp_orb::motion
