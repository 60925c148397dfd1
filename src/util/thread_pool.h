#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace ktgp_orb::util {

/// Threads that share the iterations of a loop. The calling thread is one of them, so a pool of one
/// thread starts no thread. Memory is allocated only in the constructor. Only one parallelFor() may
/// run at a time; calls must not be nested.
class ThreadPool {
 public:
  /// `threads`: number of threads, including the calling thread; 0 means one thread for each core.
  explicit ThreadPool(int threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  /// Number of threads, including the calling thread.
  int threads() const { return static_cast<int>(workers_.size()) + 1; }

  /// Calls function(i) once for every i in [0, count), in any order and from any of the threads.
  /// Returns when all calls have ended. If a call throws, the loop ends early and parallelFor()
  /// throws the first exception again.
  template <typename Function>
  void parallelFor(int count, const Function& function) {
    run({[](const void* f, int i) { (*static_cast<const Function*>(f))(i); }, &function, count});
  }

 private:
  /// A loop over a function of any type. We store the function as a void pointer, because
  /// std::function may need heap memory.
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
  std::atomic<int> next_{0};  // first iteration that no thread has taken yet
  std::mutex mutex_;          // guards the members below
  std::condition_variable loop_opened_;
  std::condition_variable worker_left_;
  // The running loop. If it is null, a worker that wakes up late goes to sleep again.
  const Loop* loop_ = nullptr;
  // This and the next two members are also read without the mutex.
  std::atomic<std::uint64_t> loops_opened_{0};
  std::atomic<int> busy_workers_{0};
  std::atomic<bool> stopping_{false};
  std::exception_ptr error_;
};

}  // namespace ktgp_orb::util
