#pragma once

#include <ros/time.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>

namespace ktgp_orb {

/// Stores the newest images by their stamps until take() returns them. It stores at most the last
/// kImages images. If they need more than kBytes of memory, it drops the oldest, but always stores
/// the last kLeast images.
class ImageStore {
 public:
  static constexpr std::size_t kImages = 40;  // one second at 40 images per second
  static constexpr std::size_t kLeast = 4;
  static constexpr std::size_t kBytes = 256000000;  // 7 colour images of 12 megapixels

  /// Raises the limits kImages and kLeast by `images`. Call this in a nodelet that calls take() for
  /// an image only `images` frames later. Takes effect with the next image.
  void setLag(std::size_t images) { lag_ = images; }

  /// Adds an image. Returns how many images were dropped because of kBytes. Images dropped because
  /// of kImages are not counted, because they are so old that their homographies will not arrive
  /// any more. If take() has already returned a later image, a dropped image is not counted either:
  /// the matcher skipped it as a repeated image or because of max_rate, so it has no homography.
  std::size_t put(const sensor_msgs::ImageConstPtr& image) {
    images_.emplace(image->header.stamp, Stored{image, next_++});
    bytes_ += image->data.size();
    order_.push_back(image->header.stamp);
    while (order_.size() > kImages + lag_) dropOldest();
    std::size_t gone = 0;
    while (bytes_ > kBytes && images_.size() > kLeast + lag_) gone += dropOldest();
    return gone;
  }

  bool has(const ros::Time& stamp) const { return images_.count(stamp) > 0; }

  /// Removes and returns the oldest image with this stamp; null if none is stored.
  sensor_msgs::ImageConstPtr take(const ros::Time& stamp) {
    const Stored taken = remove(stamp);
    if (taken.image) passed_ = std::max(passed_, taken.number);
    return taken.image;
  }

  std::size_t size() const { return images_.size(); }
  std::size_t bytes() const { return bytes_; }

  void clear() {
    images_.clear();
    order_.clear();
    bytes_ = 0;
  }

 private:
  struct Stored {
    sensor_msgs::ImageConstPtr image;
    std::uint64_t number = 0;  // number in the order of arrival
  };

  Stored remove(const ros::Time& stamp) {
    const auto found = images_.find(stamp);
    if (found == images_.end()) return {};
    Stored stored = found->second;
    bytes_ -= stored.image->data.size();
    images_.erase(found);
    return stored;
  }
  std::size_t dropOldest() {
    const ros::Time oldest = order_.front();
    order_.pop_front();
    const Stored dropped = remove(oldest);
    return dropped.image && dropped.number > passed_ ? 1 : 0;
  }

  std::uint64_t next_ = 1;
  std::uint64_t passed_ = 0;  // number of the newest image that take() has returned
  std::size_t lag_ = 0;
  std::size_t bytes_ = 0;
  std::multimap<ros::Time, Stored> images_;  // two images may have the same stamp
  // Stamps in order of arrival, including the stamps of images that take() has returned.
  std::deque<ros::Time> order_;
};

}  // namespace ktgp_orb
