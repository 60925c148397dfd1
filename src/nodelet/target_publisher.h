#pragma once

#include <ktgp_orb/KtgpConfig.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <tf2_ros/transform_broadcaster.h>

#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "messages/message_conversion.h"
#include "messages/target_pose.h"
#include "nodelet/outputs.h"

namespace ktgp_orb {

/// In fixed mode: position of the reference, a flat target, in the image and in front of the
/// camera.
///
/// Publishes ~target_outline; with target_width and the camera_info of the image also ~target_pose,
/// and with target_frame the transform from the image's frame to the target. Callbacks and the
/// worker may run at the same time.
class TargetPublisher {
 public:
  /// `node`: private; its queue gets the camera_info.
  void advertise(Outputs& outputs, const ros::NodeHandle& node, const std::string& info_topic);
  /// `pixels`: kind of the images of the camera_info.
  void configure(const KtgpConfig& config, Pixels pixels);
  /// Whether a transform is sent; its subscribers are unknown.
  bool sendsTransform() const;
  /// Tells whether frames are matched; subscribes to the camera_info if it is needed. Call this and
  /// configure() from one thread at a time.
  void listen(bool listening);
  /// Call it after the messages of a frame.
  void publish(const FrameMessages& messages);
  /// Why a wanted output is not published; empty: no problem.
  std::string problem() const;
  void shutdown();

 private:
  struct Settings {
    std::string mode;
    double width = 0.0;  // m; 0: not known
    std::string frame;
    Pixels pixels = Pixels::raw;
    ProsacOptions prosac;

    bool fixed() const { return mode == "fixed"; }
  };

  Settings settings() const;
  bool isPoseWanted(const Settings& settings) const;
  void updateSubscription();
  void publishOutline(const FrameMessages& messages);
  void publishPose(const FrameMessages& messages, const Settings& settings);
  void publishPose(const std_msgs::Header& header, const PlanarPose& pose,
                   const std::string& frame);
  PixelCamera cameraOf(const FrameMessages& messages, const Settings& settings) const;

  ros::NodeHandle node_;
  std::string info_topic_;
  ros::Publisher outline_pub_;
  ros::Publisher pose_pub_;
  ros::Subscriber info_sub_;
  bool listening_ = false;
  std::unique_ptr<tf2_ros::TransformBroadcaster> broadcaster_;

  mutable std::mutex mutex_;  // guards settings_, info_ and no_pose_
  Settings settings_;
  sensor_msgs::CameraInfoConstPtr info_;
  std::string no_pose_;  // why the last frame with a target had no pose

  TargetPose target_pose_;  // used only by the worker
};

}  // namespace ktgp_orb
