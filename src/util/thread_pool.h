#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace ktgp_orb::util {

/// Threads that share the iterations of a loop. The caller works, too, so a pool of one thread
/// starts no thread. Allocates only in the constructor. parallelFor must not overlap or nest.
class ThreadPool {
 public:
  /// `threads`: including the caller, >= 0; 0: as many as the machine runs at once.
  explicit ThreadPool(int threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  /// Number of threads, including the caller.
  int threads() const { return static_cast<int>(workers_.size()) + 1; }

  /// Calls function(i) once for every i in [0, count), in any order and from any of the threads,
  /// and returns when all are done. The first exception ends the loop early and is rethrown.
  template <typename Function>
  void parallelFor(int count, const Function& function) {
    run({[](const void* f, int i) { (*static_cast<const Function*>(f))(i); }, &function, count});
  }

 private:
  /// A loop with its type erased, without std::function and heap memory.
  struct Loop {
    void (*call)(const void* function, int i);
    const void* function;
    int count;
  };

  void run(const Loop& loop);
  void work();
  void takeIterations(const Loop& loop);
  void stop();

  std::vector<std::thread> workers_;
  std::atomic<int> next_{0};  // first free iteration
  std::mutex mutex_;          // guards the members below
  std::condition_variable loop_opened_;
  std::condition_variable worker_left_;
  const Loop* loop_ = nullptr;                  // the open loop; if null, late workers sleep again
  std::atomic<std::uint64_t> loops_opened_{0};  // these three are also read without the mutex
  std::atomic<int> busy_workers_{0};
  std::atomic<bool> stopping_{false};
  std::exception_ptr error_;
};

}  // namespace ktgp_orb::util
