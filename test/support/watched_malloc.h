#pragma once

// Replaces malloc and its kin, which only glibc allows, by functions that report each call. Include
// it in one source file of a test program, which defines onAllocation(). Does nothing with a
// sanitizer, which has its own malloc.

#include <cerrno>
#include <cstddef>
#include <cstdlib>

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define KTGP_ORB_WATCHES_MALLOC 1

namespace ktgp_orb::test {

/// Called before each allocation, from any thread; may be called recursively.
void onAllocation();

}  // namespace ktgp_orb::test

extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  ktgp_orb::test::onAllocation();
  return __libc_malloc(size);
}

void* calloc(std::size_t count, std::size_t size) {
  ktgp_orb::test::onAllocation();
  return __libc_calloc(count, size);
}

void* realloc(void* memory, std::size_t size) {
  ktgp_orb::test::onAllocation();
  return __libc_realloc(memory, size);
}

void* memalign(std::size_t alignment, std::size_t size) {
  ktgp_orb::test::onAllocation();
  return __libc_memalign(alignment, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size) {
  ktgp_orb::test::onAllocation();
  return __libc_memalign(alignment, size);
}

int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  ktgp_orb::test::onAllocation();
  *memory = __libc_memalign(alignment, size);
  return *memory != nullptr ? 0 : ENOMEM;
}
}

#endif
