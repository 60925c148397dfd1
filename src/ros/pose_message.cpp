#include "ros/pose_message.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <stdexcept>

namespace ktgp_orb {
namespace {

using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;

/// Returns true if the covariance is symmetric and positive semidefinite. Tests the correlations
/// instead of the covariance, so that the result does not depend on the units (m, rad).
bool isSemidefinite(const Covariance6& covariance) {
  constexpr double kRounding = 1e-9;
  if (!(covariance.diagonal().minCoeff() >= 0.0)) return false;
  const Eigen::Array<double, 6, 1> deviation = covariance.diagonal().array().sqrt();
  const Eigen::Matrix<double, 6, 1> scale = (deviation > 0.0).select(deviation.inverse(), 1.0);
  const Covariance6 correlation = scale.asDiagonal() * covariance * scale.asDiagonal();
  if (!((correlation - correlation.transpose()).cwiseAbs().maxCoeff() < kRounding)) return false;
  return Covariance6(correlation + kRounding * Covariance6::Identity()).llt().info() ==
         Eigen::Success;
}

}  // namespace

geometry_msgs::PoseWithCovariance toMessage(const Pose3& pose, const Covariance6& covariance) {
  const Eigen::Vector3d position = pose.translation();
  const Eigen::Quaterniond rotation(Eigen::Matrix3d(pose.linear()));
  geometry_msgs::PoseWithCovariance message;
  message.pose.position.x = position.x();
  message.pose.position.y = position.y();
  message.pose.position.z = position.z();
  message.pose.orientation.x = rotation.x();
  message.pose.orientation.y = rotation.y();
  message.pose.orientation.z = rotation.z();
  message.pose.orientation.w = rotation.w();
  Eigen::Map<RowMajor6>(message.covariance.data()) = covariance;
  return message;
}

geometry_msgs::TwistWithCovariance toMessage(const Twist6& twist, const Covariance6& covariance) {
  geometry_msgs::TwistWithCovariance message;
  message.twist.linear.x = twist(0);
  message.twist.linear.y = twist(1);
  message.twist.linear.z = twist(2);
  message.twist.angular.x = twist(3);
  message.twist.angular.y = twist(4);
  message.twist.angular.z = twist(5);
  Eigen::Map<RowMajor6>(message.covariance.data()) = covariance;
  return message;
}

geometry_msgs::TransformStamped transformOf(const std_msgs::Header& header,
                                            const std::string& child,
                                            const geometry_msgs::Pose& pose) {
  geometry_msgs::TransformStamped message;
  message.header = header;
  message.child_frame_id = child;
  message.transform.translation.x = pose.position.x;
  message.transform.translation.y = pose.position.y;
  message.transform.translation.z = pose.position.z;
  message.transform.rotation = pose.orientation;
  return message;
}

Pose3 poseOf(const geometry_msgs::Pose& pose) {
  const Eigen::Vector3d position(pose.position.x, pose.position.y, pose.position.z);
  if (!position.allFinite()) {
    throw std::invalid_argument("the position has a number that is not finite");
  }
  const Eigen::Quaterniond turn(pose.orientation.w, pose.orientation.x, pose.orientation.y,
                                pose.orientation.z);
  if (!(std::abs(turn.norm() - 1.0) < 0.01)) {
    throw std::invalid_argument("the orientation has a length of " + std::to_string(turn.norm()) +
                                "; expected a quaternion of length 1");
  }
  Pose3 result = Pose3::Identity();
  result.linear() = turn.normalized().toRotationMatrix();
  result.translation() = position;
  return result;
}

Covariance6 covarianceOf(const geometry_msgs::PoseWithCovariance& pose) {
  Covariance6 covariance = Eigen::Map<const RowMajor6>(pose.covariance.data());
  if (!covariance.allFinite()) {
    throw std::invalid_argument("the covariance has a number that is not finite");
  }
  if (isSemidefinite(covariance)) return covariance;
  throw std::invalid_argument(
      "the covariance is none: it is not symmetric, or not positive semidefinite");
}

}  // namespace ktgp_orb
