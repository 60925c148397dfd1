#pragma once

#include <boost/pointer_cast.hpp>
#include <boost/shared_ptr.hpp>
#include <exception>
#include <functional>
#include <future>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "nodelet/inbox.h"

namespace ktgp_orb {

/// A thread and the state that only this thread touches: others send it jobs, which are done in the
/// order of their arrival. A job that throws is lost, and reported; the thread goes on.
template <typename State>
class Worker {
 public:
  using Job = std::function<void(State&)>;
  using Failed = std::function<void(const std::exception&)>;
  static constexpr std::size_t kCommand = 0;  // kind of job that is never dropped

  ~Worker() { stop(); }

  /// `afterwards` is done when all jobs that had arrived are done.
  void start(std::unique_ptr<State> state, Failed failed, Job afterwards = nullptr) {
    state_ = std::move(state);
    failed_ = std::move(failed);
    afterwards_ = std::move(afterwards);
    thread_ = std::thread([this] { run(); });
  }
  /// Waits for the running job; the others are dropped.
  void stop() {
    inbox_.close();
    if (thread_.joinable()) thread_.join();
  }

  /// The following may be called from any thread; what is sent before start() waits for it.
  void setLimits(std::size_t kind, std::size_t items, std::size_t bytes = Inbox<Entry>::kNoLimit) {
    inbox_.setLimits(kind, items, bytes);
  }
  void post(Job job) { inbox_.put(kCommand, 0, {std::move(job), nullptr, nullptr}); }
  /// Calls `Use`, a function of the state, with the message. The job may be dropped, see Inbox;
  /// returns how many older ones were. Asks the heap for nothing in steady state.
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

  /// Waits for the result of a job, or for what it throws; std::future_error after stop(). Not for
  /// the worker's own thread.
  template <typename Question>
  auto ask(Question question) {
    using Result = decltype(question(std::declval<State&>()));
    auto task = std::make_shared<std::packaged_task<Result(State&)>>(std::move(question));
    std::future<Result> result = task->get_future();
    // The job alone holds the task: a job that is dropped breaks the promise, and nobody waits.
    post([task = std::move(task)](State& state) { (*task)(state); });
    return result.get();
  }

 private:
  using MessagePtr = boost::shared_ptr<const void>;
  /// A command, or a message and its use.
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
        entry = {};  // it holds a message
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
