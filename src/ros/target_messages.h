#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <ktgp_orb/TargetDetections.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include <string>
#include <vector>

#include "ktgp_orb/target_finder.h"
#include "ktgp_orb/target_pose.h"
#include "ros/camera.h"
#include "sequence/repeats.h"

namespace ktgp_orb {

/// Makes a TargetFinder forget the targets that it follows when a sequence of images ends, for
/// example because a bag starts again or the camera changes. Also detects repeated images, because
/// a velocity computed from them would be wrong.
class ImageSequence {
 public:
  /// Call this with each image before you search it for targets. `grey`: the pixels of the image.
  /// Returns false if the image repeats the previous image, so that it is not a new frame (see
  /// sequence::Repeats).
  bool next(const sensor_msgs::ImageConstPtr& image, const cv::Mat& grey, TargetFinder& finder);
  /// Makes the next image count as a new frame even if it repeats the previous image. Call this if
  /// the targets or the options of the search have changed.
  void searchAnew() { last_.reset(); }

 private:
  sequence::Repeats repeats_;
  sensor_msgs::ImageConstPtr last_;  // previous image; owns the pixels of grey_
  cv::Mat grey_;
  ros::Time stamp_;
  cv::Size size_;
};

/// Converts the detections to a message without poses; addPoses() adds the poses. `header`: header
/// of the image. `frame_prefix`: prefix for the names of the targets' tf frames.
TargetDetectionsPtr toMessage(const std_msgs::Header& header, const TargetFrame& frame,
                              const std::string& frame_prefix = "");

/// Returns true if the detection is reliable and its target has a width or a tf frame: whoever gave
/// these expects a pose.
bool wantsPose(const TargetDetection& detection);

/// Adds the poses of the targets that have a width. If a target has no pose, `no_pose` of the
/// message says why; a target for which wantsPose() is true comes first. `info`: calibration of the
/// images; null if none arrived on `info_topic`.
void addPoses(const TargetFrame& frame, const cv::Size& image, const sensor_msgs::CameraInfo* info,
              const std::string& info_topic, Pixels pixels, TargetPose& pose,
              TargetDetections& message);

/// A transform for each unambiguous pose of a target that has a tf frame. The frame is FRAME for
/// instance 0, FRAME_1 for instance 1 ... Throws std::invalid_argument if the images have no
/// frame_id.
std::vector<geometry_msgs::TransformStamped> transformsOf(const TargetDetections& message);

/// Markers for rviz: outline and id of each pose. The first marker removes the previous markers.
visualization_msgs::MarkerArrayPtr markersOf(const TargetDetections& message);

}  // namespace ktgp_orb
