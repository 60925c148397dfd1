#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>

namespace ktgp_orb {

/// Hands values from one thread to another, one place wide: a value that comes while another one
/// waits replaces it, so that the taker always gets the newest and never falls behind.
template <typename T>
class NewestSlot {
 public:
  /// Leaves `value` for the taker. True where it replaced one that nobody took.
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

  /// Waits for a value; nothing once the slot is closed.
  std::optional<T> take() {
    std::unique_lock<std::mutex> lock(mutex_);
    ready_.wait(lock, [this] { return closed_ || value_.has_value(); });
    if (closed_) return std::nullopt;
    return std::exchange(value_, std::nullopt);
  }

  /// True while a value waits to be taken.
  bool waiting() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return value_.has_value();
  }

  /// Forgets the waiting value.
  void clear() {
    const std::lock_guard<std::mutex> lock(mutex_);
    value_.reset();
  }

  /// Wakes the taker for good.
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
