#include "nodelet/target_publisher.h"

#include <ktgp_orb/MatchStatus.h>

#include <geometry_msgs/PolygonStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/TransformStamped.h>

#include <array>
#include <boost/make_shared.hpp>
#include <stdexcept>

namespace ktgp_orb {
namespace {

using Lock = std::lock_guard<std::mutex>;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

ProsacOptions prosacOptions(const KtgpConfig& config) {
  ProsacOptions options;
  options.max_error = config.prosac_threshold;
  options.max_iterations = config.prosac_iterations;
  options.confidence = config.prosac_confidence;
  options.seed = static_cast<std::uint64_t>(config.prosac_seed);
  return options;
}

}  // namespace

void TargetPublisher::advertise(Outputs& outputs, const ros::NodeHandle& node,
                                const std::string& info_topic) {
  node_ = node;
  info_topic_ = info_topic;
  outline_pub_ = outputs.advertise<geometry_msgs::PolygonStamped>("target_outline", 1);
  pose_pub_ = outputs.advertise<geometry_msgs::PoseWithCovarianceStamped>("target_pose", 1);
  broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
}

void TargetPublisher::configure(const KtgpConfig& config, Pixels pixels) {
  {
    const Lock lock(mutex_);
    settings_ = {config.reference_mode, config.target_width, config.target_frame, pixels,
                 prosacOptions(config)};
    no_pose_.clear();
  }
  updateSubscription();
}

TargetPublisher::Settings TargetPublisher::settings() const {
  const Lock lock(mutex_);
  return settings_;
}

// Listeners of tf are unknown.
bool TargetPublisher::isPoseWanted(const Settings& settings) const {
  return pose_pub_.getNumSubscribers() > 0 || !settings.frame.empty();
}

bool TargetPublisher::sendsTransform() const {
  const Settings now = settings();
  return now.fixed() && now.width > 0.0 && !now.frame.empty();
}

std::string TargetPublisher::problem() const {
  const Settings now = settings();
  const bool pose = isPoseWanted(now);
  if (!pose && outline_pub_.getNumSubscribers() == 0) return "";
  if (!now.fixed()) {
    return "the target is not searched: reference_mode is " + now.mode + ", not fixed";
  }
  if (pose && now.width <= 0.0) return "the target has no pose: target_width is not set";
  const Lock lock(mutex_);
  return pose && !no_pose_.empty() ? "the target has no pose: " + no_pose_ : "";
}

void TargetPublisher::listen(bool listening) {
  listening_ = listening;
  updateSubscription();
}

void TargetPublisher::updateSubscription() {
  const Settings now = settings();
  const bool wanted = listening_ && now.fixed() && now.width > 0.0;
  if (!wanted) info_sub_.shutdown();
  if (!wanted || info_sub_) return;
  info_sub_ = node_.subscribe<sensor_msgs::CameraInfo>(
      info_topic_, 1,
      [this](const sensor_msgs::CameraInfoConstPtr& info) {
        const Lock lock(mutex_);
        info_ = info;
      },
      ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
}

void TargetPublisher::publish(const FrameMessages& messages) {
  const Settings now = settings();
  if (!now.fixed()) return;
  if (outline_pub_.getNumSubscribers() > 0) publishOutline(messages);
  if (now.width > 0.0 && isPoseWanted(now)) publishPose(messages, now);
}

/// Four corners in px (z = 0), clockwise from the reference's upper left one; empty if the target
/// is not found, so that an old outline is not taken for a new one.
void TargetPublisher::publishOutline(const FrameMessages& messages) {
  const auto message = boost::make_shared<geometry_msgs::PolygonStamped>();
  message->header = messages.homography->header;
  if (messages.correspondences && messages.homography->status == MatchStatus::STATUS_OK) {
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

/// Throws std::invalid_argument if there is no camera for the pixels of the frame.
PixelCamera TargetPublisher::cameraOf(const FrameMessages& messages,
                                      const Settings& settings) const {
  sensor_msgs::CameraInfoConstPtr info;
  {
    const Lock lock(mutex_);
    info = info_;
  }
  if (!info) throw std::invalid_argument("no camera_info on " + info_topic_);
  const cv::Size image(static_cast<int>(messages.correspondences->image_width),
                       static_cast<int>(messages.correspondences->image_height));
  try {
    const bool rectified = messages.homography->rectified != 0;
    return pixelCamera(*info, rectified ? Pixels::rectified : settings.pixels, image);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(info_topic_ + " cannot be used: " + error.what());
  }
}

void TargetPublisher::publishPose(const FrameMessages& messages, const Settings& settings) {
  if (messages.homography->status != MatchStatus::STATUS_OK) return;  // no target found
  std::string problem;
  try {
    const PixelCamera camera = cameraOf(messages, settings);
    target_pose_.setOptions(settings.prosac);
    const auto pose = target_pose_.find(messages, camera, settings.width);
    if (pose) publishPose(messages.homography->header, *pose, settings.frame);
  } catch (const std::invalid_argument& error) {
    problem = error.what();
  }
  const Lock lock(mutex_);
  no_pose_ = problem;
}

void TargetPublisher::publishPose(const std_msgs::Header& header, const PlanarPose& pose,
                                  const std::string& frame) {
  const Eigen::Quaterniond rotation(pose.target_to_camera.linear());
  const Eigen::Vector3d position = pose.target_to_camera.translation();
  const auto message = boost::make_shared<geometry_msgs::PoseWithCovarianceStamped>();
  message->header = header;
  message->pose.pose.position.x = position.x();
  message->pose.pose.position.y = position.y();
  message->pose.pose.position.z = position.z();
  message->pose.pose.orientation.x = rotation.x();
  message->pose.pose.orientation.y = rotation.y();
  message->pose.pose.orientation.z = rotation.z();
  message->pose.pose.orientation.w = rotation.w();
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(message->pose.covariance.data()) =
      pose.covariance;
  pose_pub_.publish(message);
  if (frame.empty()) return;
  geometry_msgs::TransformStamped transform;
  transform.header = header;
  transform.child_frame_id = frame;
  transform.transform.translation.x = position.x();
  transform.transform.translation.y = position.y();
  transform.transform.translation.z = position.z();
  transform.transform.rotation = message->pose.pose.orientation;
  broadcaster_->sendTransform(transform);
}

void TargetPublisher::shutdown() {
  info_sub_.shutdown();
  broadcaster_.reset();
}

}  // namespace ktgp_orb
