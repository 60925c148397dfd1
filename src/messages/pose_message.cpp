#include "messages/pose_message.h"

#include <Eigen/Geometry>
#include <cmath>
#include <stdexcept>

namespace ktgp_orb {
namespace {

using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;

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
  const Eigen::Quaterniond turn(pose.orientation.w, pose.orientation.x, pose.orientation.y,
                                pose.orientation.z);
  if (!(std::abs(turn.norm() - 1.0) < 0.01)) {
    throw std::invalid_argument("the orientation has a length of " + std::to_string(turn.norm()) +
                                "; expected a quaternion of length 1");
  }
  Pose3 result = Pose3::Identity();
  result.linear() = turn.normalized().toRotationMatrix();
  result.translation() << pose.position.x, pose.position.y, pose.position.z;
  return result;
}

Covariance6 covarianceOf(const geometry_msgs::PoseWithCovariance& pose) {
  return Eigen::Map<const RowMajor6>(pose.covariance.data());
}

}  // namespace ktgp_orb
