#include "core/util/thread_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

#include "allocation_counter.h"

namespace ktgp_orb::util {
namespace {

TEST(ThreadPool, RunsEveryIterationOnceForAnyNumberOfThreads) {
  for (int threads : {1, 2, 3, 8}) {
    ThreadPool pool(threads);
    EXPECT_EQ(pool.threads(), threads);
    for (int count = 0; count <= 200; ++count) {
      std::vector<std::atomic<int>> calls(static_cast<std::size_t>(count));
      pool.parallelFor(count, [&](int i) { ++calls[static_cast<std::size_t>(i)]; });
      for (const std::atomic<int>& c : calls) ASSERT_EQ(c, 1) << count << " on " << threads;
    }
  }
}

TEST(ThreadPool, FinishesEveryIterationBeforeItReturns) {
  ThreadPool pool(4);
  for (int repetition = 0; repetition < 2000; ++repetition) {
    std::vector<int> values(5, 0);  // plain ints: a worker still writing would be a race
    pool.parallelFor(5, [&](int i) { values[static_cast<std::size_t>(i)] = i + repetition; });
    for (int i = 0; i < 5; ++i) ASSERT_EQ(values[static_cast<std::size_t>(i)], i + repetition);
  }
}

TEST(ThreadPool, UsesItsThreads) {
  ThreadPool pool(2);
  std::atomic<int> arrived{0};
  // Each iteration waits for the other: a single thread would never finish.
  pool.parallelFor(2, [&](int) {
    ++arrived;
    while (arrived < 2) std::this_thread::yield();
  });
  EXPECT_EQ(arrived, 2);
}

TEST(ThreadPool, StaysOnTheCallerWithOneThread) {
  ThreadPool pool(1);
  const auto caller = std::this_thread::get_id();
  pool.parallelFor(10, [&](int) { EXPECT_EQ(std::this_thread::get_id(), caller); });
}

TEST(ThreadPool, ThrowsOnWhatAnIterationThrewAndStaysUsable) {
  for (int threads : {1, 2, 3}) {
    ThreadPool pool(threads);
    for (int repetition = 0; repetition < 100; ++repetition) {
      EXPECT_THROW(pool.parallelFor(50,
                                    [](int i) {
                                      if (i % 7 == 3) throw std::runtime_error("no");
                                    }),
                   std::runtime_error);
      std::atomic<int> calls{0};
      pool.parallelFor(20, [&](int) { ++calls; });
      ASSERT_EQ(calls, 20);
    }
  }
}

TEST(ThreadPool, AllocatesNothingOnceBuilt) {
  ThreadPool pool(3);
  std::atomic<int> sum{0};
  const auto add = [&](int i) { sum += i; };
  pool.parallelFor(100, add);
  const test::AllocationCounter allocations;
  for (int repetition = 0; repetition < 100; ++repetition) pool.parallelFor(100, add);
  EXPECT_EQ(allocations.count(), 0u);
  EXPECT_EQ(sum, 101 * 4950);
}

TEST(ThreadPool, CountsItsOwnAllocations) {  // tests the counter
  const test::AllocationCounter allocations;
  const std::vector<int> some(10);
  EXPECT_EQ(allocations.count(), 1u);
  EXPECT_EQ(allocations.bytes(), 10 * sizeof(int));
}

TEST(ThreadPool, ZeroMeansAllOfTheMachine) {
  EXPECT_GE(ThreadPool(0).threads(), 1);
}

TEST(ThreadPool, RefusesANegativeNumberOfThreads) {
  EXPECT_THROW(ThreadPool(-1), std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb::util
