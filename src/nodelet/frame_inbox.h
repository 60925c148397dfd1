#pragma once

#include <ktgp_orb/HomographyStamped.h>
#include <sensor_msgs/Image.h>

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <limits>
#include <mutex>
#include <optional>
#include <utility>

namespace ktgp_orb {

/// Passes everything that arrives to a worker at once. If the worker is late, the oldest items are
/// dropped, never the newest.
class FrameInbox {
 public:
  struct Content {
    std::deque<sensor_msgs::ImageConstPtr> images;
    std::deque<HomographyStampedConstPtr> homographies;
  };

  /// How many older ones were dropped.
  std::size_t put(const sensor_msgs::ImageConstPtr& image) {
    std::size_t gone = 0;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      std::deque<sensor_msgs::ImageConstPtr>& images = content_.images;
      images.push_back(image);
      bytes_ += image->data.size();
      for (; images.size() > kImages || (bytes_ > most_bytes_ && images.size() > 1); ++gone) {
        bytes_ -= images.front()->data.size();
        images.pop_front();
      }
    }
    ready_.notify_one();
    return gone;
  }
  void put(const HomographyStampedConstPtr& homography) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      content_.homographies.push_back(homography);
      if (content_.homographies.size() > kHomographies) content_.homographies.pop_front();
    }
    ready_.notify_one();
  }

  /// Limit for the pixels of the images; the newest image always stays.
  void setMostBytes(std::size_t bytes) {
    const std::lock_guard<std::mutex> lock(mutex_);
    most_bytes_ = bytes;
  }

  /// Makes take() return, also without new messages.
  void wake() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      woken_ = true;
    }
    ready_.notify_one();
  }

  /// Waits for messages; empty after close().
  std::optional<Content> take() {
    std::unique_lock<std::mutex> lock(mutex_);
    ready_.wait(lock, [this] {
      return closed_ || woken_ || !content_.images.empty() || !content_.homographies.empty();
    });
    if (closed_) return std::nullopt;
    woken_ = false;
    bytes_ = 0;
    return std::exchange(content_, Content());
  }

  void clear() {
    const std::lock_guard<std::mutex> lock(mutex_);
    content_ = {};
    bytes_ = 0;
  }

  /// Wakes the worker for the last time.
  void close() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      closed_ = true;
    }
    ready_.notify_all();
  }

 private:
  static constexpr std::size_t kImages = 10;
  static constexpr std::size_t kHomographies = 300;  // small, and each is a link of the chain

  std::mutex mutex_;
  std::condition_variable ready_;
  Content content_;
  std::size_t bytes_ = 0;
  std::size_t most_bytes_ = std::numeric_limits<std::size_t>::max();
  bool woken_ = false;
  bool closed_ = false;
};

}  // namespace ktgp_orb
