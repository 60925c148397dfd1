#pragma once

#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <cstddef>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

namespace ktgp_orb {

/// A bag that cannot be used at all; what() says why.
class UnusableBag : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// An image as it was recorded.
struct RecordedImage {
  sensor_msgs::ImageConstPtr image;  ///< null where a compressed image cannot be decoded
  ros::Time received;
};

/// The images of one topic of a bag, in the order of their times.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// The next image that can be read, or nothing at the end. Throws only for lack of memory.
  virtual std::optional<RecordedImage> next() = 0;
  /// Number of images that the bag's index knows of.
  virtual std::size_t total() const = 0;
  /// The topic the images are from.
  virtual const std::string& topic() const = 0;
  /// What is wrong with the bag, as far as it was read, beginning with the number of images lost,
  /// where that is known; empty for a sound one.
  virtual std::string damage() const = 0;
};

/// Which images of a bag are wanted.
struct BagSelection {
  std::string topic;       ///< empty: the only image topic
  double start = 0.0;      ///< s after the beginning of the bag
  double duration = -1.0;  ///< s; below 0: to the end
};

/// Opens the images (sensor_msgs/Image or CompressedImage) of one topic of a bag, damaged or not.
/// Throws UnusableBag for what is no bag, for one without images on the topic or in the time, and
/// where no topic is given and there is not exactly one; the message names the image topics.
std::unique_ptr<ImageSource> openBag(const std::string& path, const BagSelection& selection);

/// What is wrong with a bag; empty for a sound one, which librosbag reads without harm. Reads all
/// of it. Throws UnusableBag for what is no bag.
std::string damageOf(const std::string& path);

/// Namespace of the camera that has the image topic; of a topic with the suffix of the compressed
/// transport, too.
std::string cameraOf(std::string image_topic);

/// The first camera_info beside the image topic. Throws UnusableBag where there is none.
sensor_msgs::CameraInfo readCameraInfo(const std::string& path, const std::string& image_topic);

}  // namespace ktgp_orb
