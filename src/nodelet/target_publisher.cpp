#include "nodelet/target_publisher.h"

#include <geometry_msgs/PolygonStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/TransformStamped.h>

#include <array>
#include <boost/make_shared.hpp>

#include "ktgp_orb/planar_pose.h"

namespace ktgp_orb {
namespace {

using Lock = std::lock_guard<std::mutex>;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

/// K of the image without distortion: that of P, where there is one.
Eigen::Matrix3d intrinsics(const sensor_msgs::CameraInfo& info) {
  if (info.P[0] <= 0.0) return Eigen::Map<const RowMajor3>(info.K.data());
  Eigen::Matrix3d k;
  k << info.P[0], info.P[1], info.P[2], info.P[4], info.P[5], info.P[6], 0.0, 0.0, 1.0;
  return k;
}

}  // namespace

void TargetPublisher::advertise(ros::NodeHandle& node, const std::string& info_topic,
                                const std::function<void()>& changed) {
  node_ = node;
  info_topic_ = info_topic;
  const ros::SubscriberStatusCallback callback = [changed](const ros::SingleSubscriberPublisher&) {
    changed();
  };
  outline_pub_ =
      node.advertise<geometry_msgs::PolygonStamped>("target_outline", 1, callback, callback);
  pose_pub_ = node.advertise<geometry_msgs::PoseWithCovarianceStamped>("target_pose", 1, callback,
                                                                       callback);
  broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
}

void TargetPublisher::configure(const KtgpConfig& config) {
  {
    const Lock lock(mutex_);
    settings_ = {config.reference_mode == "fixed", config.target_width, config.target_frame};
  }
  updateSubscription();
}

TargetPublisher::Settings TargetPublisher::settings() const {
  const Lock lock(mutex_);
  return settings_;
}

bool TargetPublisher::isWanted() const {
  if (outline_pub_.getNumSubscribers() > 0 || pose_pub_.getNumSubscribers() > 0) return true;
  const Settings now = settings();
  return now.fixed && now.width > 0.0 && !now.frame.empty();  // nobody can tell who looks at tf
}

void TargetPublisher::listen(bool listening) {
  listening_ = listening;
  updateSubscription();
}

void TargetPublisher::updateSubscription() {
  const Settings now = settings();
  const bool wanted = listening_ && now.fixed && now.width > 0.0;
  if (!wanted) info_sub_.shutdown();
  if (!wanted || info_sub_) return;
  info_sub_ = node_.subscribe<sensor_msgs::CameraInfo>(
      info_topic_, 1, [this](const sensor_msgs::CameraInfoConstPtr& info) {
        const Lock lock(mutex_);
        info_ = info;
      });
}

void TargetPublisher::publish(const FrameMessages& messages) {
  const Settings now = settings();
  if (!now.fixed) return;
  if (outline_pub_.getNumSubscribers() > 0) publishOutline(messages);
  if (now.width > 0.0 && (pose_pub_.getNumSubscribers() > 0 || !now.frame.empty())) {
    publishPose(messages, now);
  }
}

/// Four corners in px (z = 0), from the reference's upper left one clockwise; none where the target
/// is not found, so that nobody takes the last one for this one.
void TargetPublisher::publishOutline(const FrameMessages& messages) {
  const auto message = boost::make_shared<geometry_msgs::PolygonStamped>();
  message->header = messages.homography->header;
  if (messages.correspondences && messages.homography->status == HomographyStamped::STATUS_OK) {
    const Eigen::Matrix3d h = Eigen::Map<const RowMajor3>(messages.homography->homography.data());
    const double right = messages.correspondences->reference_width - 1.0;
    const double bottom = messages.correspondences->reference_height - 1.0;
    const std::array<Eigen::Vector3d, 4> corners{
        {{0.0, 0.0, 1.0}, {right, 0.0, 1.0}, {right, bottom, 1.0}, {0.0, bottom, 1.0}}};
    for (const Eigen::Vector3d& corner : corners) {
      const Eigen::Vector2d p = (h * corner).hnormalized();
      geometry_msgs::Point32 point;
      point.x = static_cast<float>(p.x());
      point.y = static_cast<float>(p.y());
      message->polygon.points.push_back(point);
    }
  }
  outline_pub_.publish(message);
}

void TargetPublisher::publishPose(const FrameMessages& messages, const Settings& settings) {
  sensor_msgs::CameraInfoConstPtr info;
  {
    const Lock lock(mutex_);
    info = info_;
  }
  const HomographyStamped& found = *messages.homography;
  if (!info || !messages.correspondences || found.status != HomographyStamped::STATUS_OK) return;
  const Eigen::Matrix3d camera = intrinsics(*info);
  if (!(camera(0, 0) > 0.0 && camera(1, 1) > 0.0)) return;  // not calibrated
  const cv::Size reference(static_cast<int>(messages.correspondences->reference_width),
                           static_cast<int>(messages.correspondences->reference_height));
  using RowMajor8 = Eigen::Matrix<double, 8, 8, Eigen::RowMajor>;
  const auto pose = planarPose(Eigen::Map<const RowMajor3>(found.homography.data()),
                               Eigen::Map<const RowMajor8>(found.covariance.data()), camera,
                               reference, settings.width);
  if (!pose) return;
  const Eigen::Quaterniond rotation(pose->target_to_camera.linear());
  const Eigen::Vector3d position = pose->target_to_camera.translation();
  const auto message = boost::make_shared<geometry_msgs::PoseWithCovarianceStamped>();
  message->header = found.header;
  message->pose.pose.position.x = position.x();
  message->pose.pose.position.y = position.y();
  message->pose.pose.position.z = position.z();
  message->pose.pose.orientation.x = rotation.x();
  message->pose.pose.orientation.y = rotation.y();
  message->pose.pose.orientation.z = rotation.z();
  message->pose.pose.orientation.w = rotation.w();
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(message->pose.covariance.data()) =
      pose->covariance;
  pose_pub_.publish(message);
  if (settings.frame.empty()) return;
  geometry_msgs::TransformStamped transform;
  transform.header = found.header;
  transform.child_frame_id = settings.frame;
  transform.transform.translation.x = position.x();
  transform.transform.translation.y = position.y();
  transform.transform.translation.z = position.z();
  transform.transform.rotation = message->pose.pose.orientation;
  broadcaster_->sendTransform(transform);
}

void TargetPublisher::shutdown() {
  info_sub_.shutdown();
  outline_pub_.shutdown();
  pose_pub_.shutdown();
  broadcaster_.reset();
}

}  // namespace ktgp_orb
