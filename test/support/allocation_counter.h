#pragma once

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <new>

// Counts every operator new of the program, from all threads. It replaces the global operators, so
// include it in one source file of a test program only.

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

inline void* countedAllocation(std::size_t size, std::size_t alignment) {
  ++allocation_count;
  allocated_bytes += size;
  // aligned_alloc requires a multiple of the alignment; requests for zero bytes also get a pointer.
  const std::size_t rounded = (size + alignment) / alignment * alignment;
  bool (*const may)() = may_allocate;
  if (may == nullptr || may()) {
    if (void* memory = std::aligned_alloc(alignment, rounded)) return memory;
  }
  throw std::bad_alloc();
}

}  // namespace ktgp_orb::test

// Where the compiler inlines only one of a pair, it warns that free() gets memory of operator new.
#define KTGP_ORB_TEST_NOINLINE __attribute__((noinline))

KTGP_ORB_TEST_NOINLINE void* operator new(std::size_t size) {
  return ktgp_orb::test::countedAllocation(size, alignof(std::max_align_t));
}
KTGP_ORB_TEST_NOINLINE void* operator new(std::size_t size, std::align_val_t alignment) {
  return ktgp_orb::test::countedAllocation(size, static_cast<std::size_t>(alignment));
}
KTGP_ORB_TEST_NOINLINE void operator delete(void* memory) noexcept {
  std::free(memory);
}
KTGP_ORB_TEST_NOINLINE void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
KTGP_ORB_TEST_NOINLINE void operator delete(void* memory, std::align_val_t) noexcept {
  std::free(memory);
}
KTGP_ORB_TEST_NOINLINE void operator delete(void* memory, std::size_t, std::align_val_t) noexcept {
  std::free(memory);
}
