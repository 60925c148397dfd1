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

/// The configuration of the matcher from parameters, files and messages. Belongs to the thread of
/// the settings queue. Each function that returns true has changed configuration() as a whole, and
/// counted the change; what throws has changed nothing.
class MatcherSettings {
 public:
  const Configuration& configuration() const { return configuration_; }

  /// Throws std::exception for unusable parameters and files.
  void configure(const KtgpConfig& config, const std::string& image_topic);
  /// The lens of a camera_info; if it cannot be used, `problem` says why.
  bool setLens(const sensor_msgs::CameraInfo& info, std::string& problem);
  /// The camera of the two-view geometry, the same way.
  bool setCamera(const sensor_msgs::CameraInfoConstPtr& info, std::string& problem);
  /// Throws RefusedImage.
  void setMask(const sensor_msgs::ImageConstPtr& image);
  void setReference(const sensor_msgs::ImageConstPtr& image);
  /// Reads the reference file again if it has changed. Unless `at_once`, only after it has been
  /// stable since the last call, since it may be half written. Throws RefusedImage.
  bool rereadReference(bool at_once);
  const std::string& referenceFile() const { return reference_file_; }

 private:
  /// Size and time stamp: they identify a version of a file. Zero if there is none.
  using FileState = std::pair<std::uintmax_t, std::filesystem::file_time_type>;

  static FileState stateOf(const std::string& path);

  Configuration configuration_;
  bool is_configured_ = false;
  LensConstPtr lens_;  // lens of the last camera_info
  sensor_msgs::CameraInfoConstPtr camera_;
  std::string reference_file_;
  std::string mask_file_;
  sensor_msgs::ImageConstPtr file_reference_;
  FileState file_state_;  // state of the reference file when it was read
  FileState file_seen_;   // its state at the last check
};

}  // namespace ktgp_orb
