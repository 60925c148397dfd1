#include "util/thread_pool.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "util/options_check.h"

namespace ktgp_orb::util {
namespace {

// Waits until `condition` is true. Waking a sleeping thread takes about as long as a short loop, so
// the waiting thread polls for some tens of microseconds and yields to other threads in between. We
// limit the time of the polling and not the number of yields, because on a busy machine one yield
// may take as long as the time slices of all waiting threads.
template <typename Condition>
void waitAwake(const Condition& condition) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point end = Clock::now() + std::chrono::microseconds(50);
  while (!condition() && Clock::now() < end) std::this_thread::yield();
}

}  // namespace

ThreadPool::ThreadPool(int threads) {
  requireInRange("threads", threads, 0, 1024);
  // hardware_concurrency() returns 0 if it does not know the number of cores.
  if (threads == 0) threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  try {
    for (int i = 1; i < threads; ++i) workers_.emplace_back([this] { work(); });
  } catch (...) {
    stop();
    throw;
  }
}

ThreadPool::~ThreadPool() {
  stop();
}

void ThreadPool::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  loop_opened_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void ThreadPool::run(const Loop& loop) {
  next_ = 0;
  const bool shared = !workers_.empty() && loop.count > 1;
  if (shared) {
    const std::lock_guard<std::mutex> lock(mutex_);
    loop_ = &loop;
    ++loops_opened_;
  }
  if (shared) loop_opened_.notify_all();
  takeIterations(loop);
  std::unique_lock<std::mutex> lock(mutex_);
  // Wait only for the workers that are busy. Workers that wake up later find loop_ null and do
  // nothing.
  loop_ = nullptr;
  lock.unlock();
  waitAwake([this] { return busy_workers_ == 0; });
  lock.lock();
  worker_left_.wait(lock, [this] { return busy_workers_ == 0; });
  if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
}

void ThreadPool::work() {
  std::uint64_t loops_seen = 0;
  while (true) {
    waitAwake([&] { return stopping_ || loops_opened_ != loops_seen; });
    std::unique_lock<std::mutex> lock(mutex_);
    loop_opened_.wait(lock, [&] { return stopping_ || (loop_ && loops_seen != loops_opened_); });
    if (stopping_) return;
    loops_seen = loops_opened_;
    const Loop& loop = *loop_;
    ++busy_workers_;
    lock.unlock();
    takeIterations(loop);
    lock.lock();
    if (--busy_workers_ == 0) worker_left_.notify_one();
  }
}

void ThreadPool::takeIterations(const Loop& loop) {
  try {
    for (int i = next_++; i < loop.count; i = next_++) loop.call(loop.function, i);
  } catch (...) {
    next_ = loop.count;
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!error_) error_ = std::current_exception();
  }
}

}  // namespace ktgp_orb::util
