#pragma once

#include <ros/time.h>
#include <sensor_msgs/Image.h>

#include <cstddef>
#include <deque>
#include <limits>
#include <map>

namespace ktgp_orb {

/// Stores the newest images by their stamps until they are taken. Limits their number and their
/// bytes; the newest image always stays.
class ImageStore {
 public:
  explicit ImageStore(std::size_t most) : most_(most) {}

  void setMost(std::size_t images) { most_ = images; }
  void setMostBytes(std::size_t bytes) { most_bytes_ = bytes; }

  /// How many were dropped because of the bytes. Those beyond the number are too old for a
  /// homography.
  std::size_t put(const sensor_msgs::ImageConstPtr& image) {
    take(image->header.stamp);  // of two images with one stamp the newer stays
    images_[image->header.stamp] = image;
    bytes_ += image->data.size();
    order_.push_back(image->header.stamp);
    while (order_.size() > most_) dropOldest();
    std::size_t gone = 0;
    while (bytes_ > most_bytes_ && images_.size() > 1) gone += dropOldest();
    return gone;
  }

  bool has(const ros::Time& stamp) const { return images_.count(stamp) > 0; }

  /// Null if it is not stored.
  sensor_msgs::ImageConstPtr take(const ros::Time& stamp) {
    const auto found = images_.find(stamp);
    if (found == images_.end()) return nullptr;
    sensor_msgs::ImageConstPtr image = found->second;
    bytes_ -= image->data.size();
    images_.erase(found);
    return image;
  }

  std::size_t size() const { return images_.size(); }
  std::size_t bytes() const { return bytes_; }

  void clear() {
    images_.clear();
    order_.clear();
    bytes_ = 0;
  }

 private:
  std::size_t dropOldest() {
    const ros::Time oldest = order_.front();
    order_.pop_front();
    return take(oldest) ? 1 : 0;
  }

  std::size_t most_;
  std::size_t most_bytes_ = std::numeric_limits<std::size_t>::max();
  std::size_t bytes_ = 0;
  std::map<ros::Time, sensor_msgs::ImageConstPtr> images_;
  std::deque<ros::Time> order_;  // in order of arrival; includes those that were taken
};

}  // namespace ktgp_orb
