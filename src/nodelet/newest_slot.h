#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>

namespace ktgp_orb {

/// Passes values from one thread to another. Holds one value: a new value replaces a waiting one,
/// so that the receiver always gets the newest.
template <typename T>
class NewestSlot {
 public:
  /// Stores `value`. True if it replaced a value that was not taken.
  bool put(T value) {
    bool replaced = false;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      replaced = value_.has_value();
      value_ = std::move(value);
    }
    ready_.notify_one();
    return replaced;
  }

  /// Waits for a value; empty after close().
  std::optional<T> take() {
    std::unique_lock<std::mutex> lock(mutex_);
    ready_.wait(lock, [this] { return closed_ || value_.has_value(); });
    if (closed_) return std::nullopt;
    return std::exchange(value_, std::nullopt);
  }

  /// True while a value waits.
  bool waiting() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return value_.has_value();
  }

  /// Removes the waiting value.
  void clear() {
    const std::lock_guard<std::mutex> lock(mutex_);
    value_.reset();
  }

  /// Wakes the receiver for the last time.
  void close() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      closed_ = true;
      value_.reset();
    }
    ready_.notify_all();
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable ready_;
  std::optional<T> value_;
  bool closed_ = false;
};

}  // namespace ktgp_orb
