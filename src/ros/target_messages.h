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

/// Tells a TargetFinder to forget what it follows where a sequence of images ends: a looped bag, or
/// another camera. Knows images that repeat the one before, from which a velocity would be wrong.
class ImageSequence {
 public:
  /// To be called before each search. `grey`: the pixels of the image. False: it repeats the one
  /// before and is no new frame, see sequence::Repeats.
  bool next(const sensor_msgs::ImageConstPtr& image, const cv::Mat& grey, TargetFinder& finder);
  /// The next image is a new frame in any case: other targets are searched.
  void searchAnew() { last_.reset(); }

 private:
  sequence::Repeats repeats_;
  sensor_msgs::ImageConstPtr last_;  // owns the pixels of grey_
  cv::Mat grey_;
  ros::Time stamp_;
  cv::Size size_;
};

/// The message without poses. `header`: that of the image. `frame_prefix`: begins the names of the
/// targets' frames.
TargetDetectionsPtr toMessage(const std_msgs::Header& header, const TargetFrame& frame,
                              const std::string& frame_prefix = "");

/// Adds the poses of targets with a width or a frame. Where there are none, `no_pose` of the
/// message says why. `info`: calibration of the images; null: none on `info_topic`.
void addPoses(const TargetFrame& frame, const cv::Size& image, const sensor_msgs::CameraInfo* info,
              const std::string& info_topic, Pixels pixels, TargetPose& pose,
              TargetDetections& message);

/// One for each pose of a target that has a frame: FRAME for instance 0, FRAME_1 for instance 1 ...
/// Throws std::invalid_argument with the reason if the images have no frame_id.
std::vector<geometry_msgs::TransformStamped> transformsOf(const TargetDetections& message);

/// For rviz: outline and id for each pose; the first marker removes those of the frame before.
visualization_msgs::MarkerArrayPtr markersOf(const TargetDetections& message);

}  // namespace ktgp_orb
