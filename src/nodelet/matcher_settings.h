#pragma once

#include <ktgp_orb/KtgpConfig.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>

#include "ros/configuration.h"

namespace ktgp_orb {

/// Builds the matcher's configuration from parameters, files and messages. Used only in the thread
/// of the settings queue. If a function returns true, it has updated configuration() completely and
/// incremented its number. If a function throws, configuration() is unchanged.
class MatcherSettings {
 public:
  const Configuration& configuration() const { return configuration_; }

  /// Throws std::exception for unusable parameters and files.
  void configure(const KtgpConfig& config, const std::string& image_topic);
  /// Takes the lens from a camera_info; if it cannot be used, `problem` says why.
  bool setLens(const sensor_msgs::CameraInfo& info, std::string& problem);
  /// Takes the camera of the two-view geometry from a camera_info; `problem`: as in setLens().
  bool setCamera(const sensor_msgs::CameraInfoConstPtr& info, std::string& problem);
  /// The next two functions throw RefusedImage for an unusable image.
  void setMask(const sensor_msgs::ImageConstPtr& image);
  void setReference(const sensor_msgs::ImageConstPtr& image);
  /// Reads the reference file again if it has changed. If `at_once` is false, reads it only if the
  /// file was the same in the last call, because it may be half written. Throws RefusedImage.
  /// Returns true if the file was read.
  bool rereadReference(bool at_once);
  const std::string& referenceFile() const { return reference_file_; }

 private:
  /// Size and time stamp, which identify a version of a file; zero if there is no file.
  using FileState = std::pair<std::uintmax_t, std::filesystem::file_time_type>;

  static FileState stateOf(const std::string& path);
  sensor_msgs::ImageConstPtr stamped(const sensor_msgs::ImageConstPtr& image);
  sensor_msgs::ImageConstPtr readReference(const std::string& path);
  void useReference(const sensor_msgs::ImageConstPtr& image);
  static FramePtr preparedReference(const Configuration& wanted, const Configuration& before);

  Configuration configuration_;
  bool is_configured_ = false;
  LensConstPtr lens_;  // lens of the last camera_info
  sensor_msgs::CameraInfoConstPtr camera_;
  std::string reference_file_;
  std::string mask_file_;
  sensor_msgs::ImageConstPtr file_reference_;
  std::uint64_t unstamped_ = 0;  // number of references without a stamp so far
  FileState file_state_;         // state of the reference file when it was read
  FileState file_seen_;          // state of the file at the last check
};

}  // namespace ktgp_orb
