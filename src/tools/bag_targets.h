#pragma once

#include <ktgp_orb/TargetDetections.h>
#include <sensor_msgs/Image.h>

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ktgp_orb/target_finder.h"
#include "ros/target_messages.h"

namespace ktgp_orb::tools {

/// Options of the search for flat targets in the images of a recording. If `path` is empty, no
/// targets are searched for.
struct TargetsInput {
  std::string path;  ///< folder of images, or YAML list
  /// Kind of the images: by_name, raw or rectified, see pixelsFrom().
  std::string calibration = "by_name";
  double readout_time = -1.0;  ///< readout time of the shutter, s; below 0: not known
};

void addTargetsArguments(CLI::App& app, TargetsInput& targets);

/// All image files of the targets. `path`: a folder of images, or a YAML list. Throws
/// std::invalid_argument if the folder or list is unusable.
std::vector<std::string> filesOfTargets(const std::string& path);

/// The camera_info from the topic in the same namespace as the images; empty if the recording has
/// none.
std::optional<sensor_msgs::CameraInfo> cameraInfoOf(const std::string& recording,
                                                    const std::string& image_topic);

/// Finds flat targets in the images of a bag, like the targets nodelet. Unlike the nodelet, this
/// class searches every image for all targets.
class BagTargets {
 public:
  /// If `input.path` is empty, no targets are loaded and find() always returns null. Prints every
  /// refused target, with the reason, to the standard error. Throws std::invalid_argument for an
  /// unusable list, and FileError if none of its targets can be used. Uses `camera`, if given,
  /// instead of the recording's camera_info.
  BagTargets(const TargetsInput& input, const std::string& recording,
             const std::string& image_topic, const std::optional<sensor_msgs::CameraInfo>& camera);

  /// The message that the nodelet would publish on ~detections. Null if no targets are searched
  /// for, or if the image repeats the previous image. Throws RefusedImage.
  TargetDetectionsPtr find(const sensor_msgs::ImageConstPtr& image);
  /// One-line summary for users; empty if no targets are searched for.
  std::string report() const;

 private:
  TargetsInput input_;
  TargetFinder finder_;
  ImageSequence sequence_;
  TargetPose pose_;
  std::optional<sensor_msgs::CameraInfo> info_;
  std::string info_topic_;
  Pixels pixels_ = Pixels::raw;
  std::size_t refused_ = 0;
  std::size_t frames_ = 0;
  std::size_t seen_ = 0;  // number of frames in which a target was found
  std::size_t found_ = 0;
  std::size_t poses_ = 0;
  // Reason why a target had no pose, for the first such target, or for the first one that should
  // have a pose, because it has a width or a frame.
  std::string no_pose_;
  bool no_pose_is_missed_ = false;  // true if no_pose_ is for a target that should have a pose
};

}  // namespace ktgp_orb::tools
