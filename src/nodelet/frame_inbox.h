#pragma once

#include <ktgp_orb/HomographyStamped.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <map>
#include <mutex>
#include <optional>

namespace ktgp_orb {

/// Hands what arrives to a worker, all at once. A worker that is late loses the oldest, never the
/// newest.
class FrameInbox {
 public:
  struct Content {
    std::deque<sensor_msgs::ImageConstPtr> images;
    std::deque<HomographyStampedConstPtr> homographies;
    std::deque<sensor_msgs::CameraInfoConstPtr> infos;
  };

  // True where something older had to go.
  bool put(const sensor_msgs::ImageConstPtr& image) {
    return put(image, kImages, &Content::images);
  }
  bool put(const HomographyStampedConstPtr& homography) {
    return put(homography, kHomographies, &Content::homographies);
  }
  bool put(const sensor_msgs::CameraInfoConstPtr& info) {
    return put(info, kHomographies, &Content::infos);
  }

  /// Makes take() return, with nothing where nothing came.
  void wake() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      woken_ = true;
    }
    ready_.notify_one();
  }

  /// Waits for something; nothing once closed.
  std::optional<Content> take() {
    std::unique_lock<std::mutex> lock(mutex_);
    ready_.wait(lock, [this] {
      return closed_ || woken_ || !content_.images.empty() || !content_.homographies.empty() ||
             !content_.infos.empty();
    });
    if (closed_) return std::nullopt;
    woken_ = false;
    return std::exchange(content_, Content());
  }

  void clear() {
    const std::lock_guard<std::mutex> lock(mutex_);
    content_ = {};
  }

  /// Wakes the taker for good.
  void close() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      closed_ = true;
    }
    ready_.notify_all();
  }

 private:
  static constexpr std::size_t kImages = 10;
  static constexpr std::size_t kHomographies = 300;  // small, and each is a link of a chain

  template <typename Message>
  bool put(const Message& message, std::size_t most, std::deque<Message> Content::*queue) {
    bool full = false;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      std::deque<Message>& messages = content_.*queue;
      messages.push_back(message);
      full = messages.size() > most;
      if (full) messages.pop_front();
    }
    ready_.notify_one();
    return full;
  }

  std::mutex mutex_;
  std::condition_variable ready_;
  Content content_;
  bool woken_ = false;
  bool closed_ = false;
};

/// Keeps the newest values by the time they belong to, a bounded number of them.
template <typename Value>
class ByStamp {
 public:
  explicit ByStamp(std::size_t most) : most_(most) {}

  void setMost(std::size_t most) { most_ = most; }

  /// Returns how many had to go.
  std::size_t put(const ros::Time& stamp, const Value& value) {
    values_[stamp] = value;
    order_.push_back(stamp);
    std::size_t gone = 0;
    while (order_.size() > most_) {
      gone += values_.erase(order_.front());
      order_.pop_front();
    }
    return gone;
  }

  const Value* find(const ros::Time& stamp) const {
    const auto found = values_.find(stamp);
    return found == values_.end() ? nullptr : &found->second;
  }

  std::optional<Value> take(const ros::Time& stamp) {
    const auto found = values_.find(stamp);
    if (found == values_.end()) return std::nullopt;
    std::optional<Value> value = std::move(found->second);
    values_.erase(found);
    return value;
  }

  std::size_t size() const { return values_.size(); }

  void clear() {
    values_.clear();
    order_.clear();
  }

 private:
  std::size_t most_;
  std::map<ros::Time, Value> values_;
  std::deque<ros::Time> order_;  // as they came; also of those that were taken
};

}  // namespace ktgp_orb
