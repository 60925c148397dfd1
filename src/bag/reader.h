#pragma once

#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include "bag/messages.h"

namespace ktgp_orb {

/// A recorded image.
struct RecordedImage {
  sensor_msgs::ImageConstPtr image;  ///< null where it cannot be decoded
  ros::Time received;
  std::string problem{};  ///< then: why
};

/// The images of one topic of a bag, in the order of their times.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// The next readable image, or empty at the end. Throws only for lack of memory.
  virtual std::optional<RecordedImage> next() = 0;
  /// Number of images in the bag's index.
  virtual std::size_t total() const = 0;
  /// The topic of the images; of those that are not in a bag: that of a usual camera.
  const std::string& topic() const { return topic_; }
  /// Problems of the bag, as far as it was read, beginning with the number of lost images if it is
  /// known; empty for an intact bag.
  virtual std::string damage() const = 0;

 protected:
  std::string topic_ = "/camera/image_raw";
};

/// Selection of images.
struct BagSelection {
  std::string topic;       ///< empty: the only image topic
  double start = 0.0;      ///< s after the beginning of the bag
  double duration = -1.0;  ///< s; below 0: to the end
};

/// Opens the images (sensor_msgs/Image or CompressedImage) of one topic of a bag, damaged or not.
/// Throws UnusableBag for a file that is not a bag, for a bag without images on the topic or in the
/// time, and if no topic is given and there is not exactly one; the message names the image topics.
std::unique_ptr<ImageSource> openBag(const std::string& path, const BagSelection& selection);

/// Namespace of the camera of the image topic, also for topics of the compressed transport.
std::string cameraOf(const std::string& image_topic);

/// The first camera_info beside the image topic. Throws UnusableBag if there is none; `user`: what
/// needs it.
sensor_msgs::CameraInfo readCameraInfo(const std::string& path, const std::string& image_topic,
                                       const std::string& user);

}  // namespace ktgp_orb
