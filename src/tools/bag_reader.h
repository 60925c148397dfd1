#pragma once

#include <ros/time.h>
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

/// Where recorded images come from, in order.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// The next image of the topic, or nothing at the end or at the first damage.
  virtual std::optional<RecordedImage> next() = 0;
  /// Number of images, 0 where it is not known beforehand.
  virtual std::size_t total() const { return 0; }
  /// The topic the images are from.
  const std::string& topic() const { return topic_; }
  /// What is wrong with the bag, as far as it was read; empty for a sound one.
  const std::string& damage() const { return damage_; }

 protected:
  std::string topic_;
  std::string damage_;
};

/// Which images of a bag are wanted.
struct BagSelection {
  std::string topic;       ///< empty: the only image topic
  double start = 0.0;      ///< s after the beginning of the bag
  double duration = -1.0;  ///< s; below 0: to the end
};

/// Opens the images (sensor_msgs/Image or CompressedImage) of one topic of a bag: in the order of
/// their times or, where the bag has no usable index, in the order of the file up to the damage.
/// Throws UnusableBag for what is no bag, for a sound one without images on the topic or in the
/// time, and where no topic is given and there is not exactly one; the message names the image
/// topics.
std::unique_ptr<ImageSource> openBag(const std::string& path, const BagSelection& selection);

}  // namespace ktgp_orb
