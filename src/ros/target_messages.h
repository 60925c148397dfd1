#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <ktgp_orb/TargetDetections.h>
#include <sensor_msgs/CameraInfo.h>
#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include <string>
#include <vector>

#include "homography/fit.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/target_finder.h"
#include "ros/camera.h"

namespace ktgp_orb {

/// Poses of detected targets in front of a camera. An instance belongs to one thread at a time.
class DetectedPose {
 public:
  /// Readout time of a rolling shutter, from the first row to the last one, s; 0: a global shutter;
  /// below 0: not known, as at first.
  void setReadoutTime(double seconds) { readout_time_ = seconds; }

  /// Empty if it is not the view of a target in front of the camera. With lens distortion, no
  /// homography maps a flat target to the image. Then the pairs of the detection are rectified, and
  /// a homography is fitted to them. Unless the shutter is a global one, a target that was
  /// seen in the image before has the pose that it had when the middle row was exposed (see
  /// withoutShutter); `stamp` and `rows`: of the image.
  PlanarPoses find(const DetectedTarget& target, const PixelCamera& camera, const ros::Time& stamp,
                   int rows);

 private:
  struct Seen {
    std::string id;
    int instance = 0;
    std::size_t image = 0;
    ros::Time stamp;
    UncertainHomography answer;
  };

  void correctShutter(const DetectedTarget& target, const ros::Time& stamp, int rows,
                      UncertainHomography& answer);

  double readout_time_ = -1.0;
  std::vector<Seen> seen_;  // lately
  ProsacHomography prosac_;
  ProsacResult result_;
  PointPairs pairs_;
  homography::HomographyRefiner refiner_;
};

/// Tells a TargetFinder to forget what it follows where a sequence of images ends: a looped bag, or
/// another camera.
class ImageSequence {
 public:
  /// To be called before each search.
  void next(const ros::Time& stamp, const cv::Size& image, TargetFinder& finder);

 private:
  ros::Time stamp_;
  cv::Size size_;
};

/// Without poses. `header`: of the image. `frame_prefix`: begins the names of the targets' frames.
TargetDetectionsPtr toMessage(const std_msgs::Header& header, const TargetFrame& frame,
                              const std::string& frame_prefix = "");

/// Adds the poses of targets with a width or a frame. Where there are none, `no_pose` of the
/// message says why. `info`: calibration of the images; null: none on `info_topic`.
void addPoses(const TargetFrame& frame, const cv::Size& image, const sensor_msgs::CameraInfo* info,
              const std::string& info_topic, Pixels pixels, DetectedPose& pose,
              TargetDetections& message);

/// One for each pose of a target that has a frame: FRAME for instance 0, FRAME_1 for instance 1 ...
/// Throws std::invalid_argument with the reason if the images have no frame_id.
std::vector<geometry_msgs::TransformStamped> transformsOf(const TargetDetections& message);

/// For rviz: outline and id for each pose; the first marker removes those of the frame before.
visualization_msgs::MarkerArrayPtr markersOf(const TargetDetections& message);

}  // namespace ktgp_orb
