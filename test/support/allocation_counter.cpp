#include "allocation_counter.h"

#include <cstdlib>
#include <new>

namespace {

void* countedAllocation(std::size_t size, std::size_t alignment) {
  ++ktgp_orb::test::allocation_count;
  ktgp_orb::test::allocated_bytes += size;
  // aligned_alloc requires a multiple of the alignment; requests for zero bytes also get a pointer.
  const std::size_t rounded = (size + alignment) / alignment * alignment;
  bool (*const may)() = ktgp_orb::test::may_allocate;
  if (may == nullptr || may()) {
    if (void* memory = std::aligned_alloc(alignment, rounded)) return memory;
  }
  throw std::bad_alloc();
}

}  // namespace

// Where the compiler inlines only one of a pair, it warns that free() gets memory of operator new.
#define KTGP_ORB_TEST_NOINLINE __attribute__((noinline))

KTGP_ORB_TEST_NOINLINE void* operator new(std::size_t size) {
  return countedAllocation(size, alignof(std::max_align_t));
}
KTGP_ORB_TEST_NOINLINE void* operator new(std::size_t size, std::align_val_t alignment) {
  return countedAllocation(size, static_cast<std::size_t>(alignment));
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
