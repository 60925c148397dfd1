#pragma once

#include <atomic>
#include <cstddef>

// Counts every operator new of the program, from all threads: allocation_counter.cpp replaces the
// global operators.

namespace ktgp_orb::test {

inline std::atomic<std::size_t> allocation_count{0};
inline std::atomic<std::size_t> allocated_bytes{0};
/// Whether an allocation succeeds; without a function, all do.
inline std::atomic<bool (*)()> may_allocate{nullptr};

/// Number of allocations since construction, freed or not.
class AllocationCounter {
 public:
  std::size_t count() const { return allocation_count - start_count_; }
  std::size_t bytes() const { return allocated_bytes - start_bytes_; }

 private:
  std::size_t start_count_ = allocation_count;
  std::size_t start_bytes_ = allocated_bytes;
};

}  // namespace ktgp_orb::test
