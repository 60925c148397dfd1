#pragma once

#include <array>
#include <boost/pointer_cast.hpp>
#include <boost/shared_ptr.hpp>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <future>
#include <limits>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

namespace ktgp_orb {

/// A queue that passes items from any number of threads to one thread, in the order of their
/// arrival. If the items of a kind exceed its limits, the oldest are dropped; the newest item of a
/// kind is always kept.
template <typename Item>
class Inbox {
 public:
  static constexpr std::size_t kKinds = 5;
  static constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();

  /// Limits the number of waiting items of a kind (0 to kKinds - 1) and the memory that they hold.
  /// There is no limit by default.
  void setLimits(std::size_t kind, std::size_t items, std::size_t bytes = kNoLimit) {
    const std::lock_guard<std::mutex> lock(mutex_);
    kinds_[kind].most_items = items;
    kinds_[kind].most_bytes = bytes;
  }

  /// Adds an item that holds `bytes` of memory. Returns how many older items were dropped.
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

  /// Waits for an item, then replaces `items` by all items that have arrived. Returns false after
  /// close().
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

  void clear(std::size_t kind) {
    const std::lock_guard<std::mutex> lock(mutex_);
    while (kinds_[kind].items > 0) dropOldest(kind);
  }

  /// Closes the queue for good: take() no longer waits, and new items are ignored.
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

/// A thread and the state that only this thread touches. Other threads send jobs, which run in the
/// order of their arrival. A job that throws is lost and reported, and the thread goes on.
template <typename State>
class Worker {
 public:
  using Job = std::function<void(State&)>;
  using Failed = std::function<void(const std::exception&)>;
  static constexpr std::size_t kCommand = 0;  // kind of job that is never dropped

  ~Worker() { stop(); }

  /// `afterwards` is called each time the worker has done all the jobs that were waiting.
  void start(std::unique_ptr<State> state, Failed failed, Job afterwards = nullptr) {
    state_ = std::move(state);
    failed_ = std::move(failed);
    afterwards_ = std::move(afterwards);
    thread_ = std::thread([this] { run(); });
  }
  /// Waits for the end of the running job, and drops the waiting jobs.
  void stop() {
    inbox_.close();
    if (thread_.joinable()) thread_.join();
  }

  /// The following functions may be called from any thread; jobs sent before start() wait for it.
  void setLimits(std::size_t kind, std::size_t items, std::size_t bytes = Inbox<Entry>::kNoLimit) {
    inbox_.setLimits(kind, items, bytes);
  }
  void post(Job job) { inbox_.put(kCommand, 0, {std::move(job), nullptr, nullptr}); }
  /// Sends a job that calls `Use`, a member function of State, with the message. The job may be
  /// dropped, see Inbox. Returns how many older jobs were dropped. Allocates nothing in steady
  /// state.
  template <auto Use, typename Message>
  std::size_t put(std::size_t kind, std::size_t bytes,
                  const boost::shared_ptr<const Message>& message) {
    const auto use = [](State& state, const MessagePtr& taken) {
      (state.*Use)(boost::static_pointer_cast<const Message>(taken));
    };
    return inbox_.put(kind, bytes, {nullptr, message, use});
  }
  bool has(std::size_t kind) const { return inbox_.has(kind); }
  void clear(std::size_t kind) { inbox_.clear(kind); }

  /// Sends a job, waits until it is done, and returns its result or throws its exception. Throws
  /// std::future_error after stop(). Do not call this in the worker's own thread.
  template <typename Question>
  auto ask(Question question) {
    using Result = decltype(question(std::declval<State&>()));
    auto task = std::make_shared<std::packaged_task<Result(State&)>>(std::move(question));
    std::future<Result> result = task->get_future();
    // Only the job owns the task, so if the job is dropped, the promise is broken and get() below
    // throws instead of waiting forever.
    post([task = std::move(task)](State& state) { (*task)(state); });
    return result.get();
  }

 private:
  using MessagePtr = boost::shared_ptr<const void>;
  /// A command, or a message and the function that uses it.
  struct Entry {
    Job command;
    MessagePtr message;
    void (*use)(State&, const MessagePtr&);
  };

  void run() {
    std::vector<Entry> entries;
    while (inbox_.take(entries)) {
      for (Entry& entry : entries) {
        attempt([&] {
          if (entry.use != nullptr) {
            entry.use(*state_, entry.message);
          } else {
            entry.command(*state_);
          }
        });
        entry = {};  // releases the message
      }
      if (afterwards_) attempt([&] { afterwards_(*state_); });
    }
  }
  template <typename Attempt>
  void attempt(const Attempt& what) {
    try {
      what();
    } catch (const std::exception& error) {
      failed_(error);
    }
  }

  Inbox<Entry> inbox_;
  std::unique_ptr<State> state_;
  Failed failed_;
  Job afterwards_;
  std::thread thread_;
};

}  // namespace ktgp_orb
