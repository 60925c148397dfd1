#pragma once

#include <array>
#include <condition_variable>
#include <cstddef>
#include <limits>
#include <mutex>
#include <utility>
#include <vector>

namespace ktgp_orb {

/// Passes items from any number of threads to one, in the order of their arrival. What arrives
/// faster than it is taken is dropped, the oldest first, by the limits of its kind; the newest item
/// of a kind always stays.
template <typename Item>
class Inbox {
 public:
  static constexpr std::size_t kKinds = 5;
  static constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();

  /// Of the waiting items of a kind, 0 to kKinds - 1, and of the memory that they hold. Without a
  /// call there is no limit.
  void setLimits(std::size_t kind, std::size_t items, std::size_t bytes = kNoLimit) {
    const std::lock_guard<std::mutex> lock(mutex_);
    kinds_[kind].most_items = items;
    kinds_[kind].most_bytes = bytes;
  }

  /// Returns how many older ones were dropped. `bytes`: memory that the item holds.
  std::size_t put(std::size_t kind, std::size_t bytes, Item item) {
    std::size_t dropped = 0;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (closed_) return 0;
      entries_.push_back({kind, bytes, std::move(item)});
      Kind& own = kinds_[kind];
      ++own.items;
      own.bytes += bytes;
      for (; own.items > 1 && (own.items > own.most_items || own.bytes > own.most_bytes);
           ++dropped) {
        dropOldest(kind);
      }
    }
    ready_.notify_one();
    return dropped;
  }

  /// Waits, then replaces `items` by all that have arrived. False after close().
  bool take(std::vector<Item>& items) {
    items.clear();
    std::unique_lock<std::mutex> lock(mutex_);
    ready_.wait(lock, [this] { return closed_ || !entries_.empty(); });
    if (closed_) return false;
    for (Entry& entry : entries_) items.push_back(std::move(entry.item));
    empty();
    return true;
  }

  bool has(std::size_t kind) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return kinds_[kind].items > 0;
  }

  /// Drops the items of this kind.
  void clear(std::size_t kind) {
    const std::lock_guard<std::mutex> lock(mutex_);
    while (kinds_[kind].items > 0) dropOldest(kind);
  }

  /// Ends the waiting for good; nothing is accepted any more.
  void close() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      closed_ = true;
      empty();
    }
    ready_.notify_all();
  }

 private:
  struct Entry {
    std::size_t kind;
    std::size_t bytes;
    Item item;
  };
  struct Kind {
    std::size_t most_items = kNoLimit;
    std::size_t most_bytes = kNoLimit;
    std::size_t items = 0;
    std::size_t bytes = 0;
  };

  void dropOldest(std::size_t kind) {
    std::size_t i = 0;
    while (entries_[i].kind != kind) ++i;
    --kinds_[kind].items;
    kinds_[kind].bytes -= entries_[i].bytes;
    entries_.erase(entries_.begin() + static_cast<std::ptrdiff_t>(i));
  }
  void empty() {
    entries_.clear();
    for (Kind& kind : kinds_) kind.items = kind.bytes = 0;
  }

  mutable std::mutex mutex_;
  std::condition_variable ready_;
  std::vector<Entry> entries_;
  std::array<Kind, kKinds> kinds_;
  bool closed_ = false;
};

}  // namespace ktgp_orb
