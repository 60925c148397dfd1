#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

namespace ktgp_orb::util {

/// Hands out objects as shared pointers. When the last shared pointer is destroyed, the object
/// returns to the pool and keeps its memory for the next user.
///
/// The control block of a shared_ptr is freed when no shared or weak pointer to the object is left.
/// Here the control block is stored beside the object, so it needs no memory of its own, and the
/// call that frees it tells the pool that the object can be used again. The pool's mutex makes
/// everything that the last user did with the object visible to the next user; use_count() would
/// not guarantee this.
template <typename T>
class Pool {
 public:
  using Release = void (*)(T&);

  /// `most`: the pool keeps at most this many unused objects. `release`: called with each object
  /// that returns, in the thread that destroyed the last pointer to it.
  Pool(std::size_t most, Release release) : state_(std::make_shared<State>()), release_(release) {
    state_->most = most;
    state_->free.reserve(most);
  }

  /// Returns an unused object, with the content that it had when it returned to the pool, or a new
  /// object if there is none.
  std::shared_ptr<T> take() {
    Slot* const slot = state_->take().release();
    return {&slot->object, [release = release_](T* object) { release(*object); },
            BlockAllocator<T>(state_, slot)};
  }

 private:
  struct Slot {
    T object;
    alignas(std::max_align_t) unsigned char block[128];
  };
  struct State {
    std::unique_ptr<Slot> take() {
      {
        const std::lock_guard<std::mutex> lock(mutex);
        if (!free.empty()) {
          std::unique_ptr<Slot> slot = std::move(free.back());
          free.pop_back();
          return slot;
        }
      }
      return std::make_unique<Slot>();
    }
    void give(std::unique_ptr<Slot> slot) {
      const std::lock_guard<std::mutex> lock(mutex);
      if (free.size() < most) free.push_back(std::move(slot));
    }

    std::mutex mutex;
    std::vector<std::unique_ptr<Slot>> free;
    std::size_t most = 0;
  };

  /// Allocator for the control block of a shared_ptr: puts it into Slot::block instead of
  /// allocating memory, and gives the slot back to the pool when the block is freed.
  template <typename Block>
  struct BlockAllocator {
    using value_type = Block;
    BlockAllocator(std::shared_ptr<State> s, Slot* of) : state(std::move(s)), slot(of) {}
    template <typename Other>
    BlockAllocator(const BlockAllocator<Other>& other)  // NOLINT(google-explicit-constructor)
        : state(other.state), slot(other.slot) {}

    Block* allocate(std::size_t /*one*/) {
      static_assert(sizeof(Block) <= sizeof(Slot::block), "the control block needs more memory");
      return reinterpret_cast<Block*>(slot->block);
    }
    void deallocate(Block* /*block*/, std::size_t /*one*/) {
      state->give(std::unique_ptr<Slot>(slot));
    }
    bool operator==(const BlockAllocator& other) const { return slot == other.slot; }
    bool operator!=(const BlockAllocator& other) const { return slot != other.slot; }

    std::shared_ptr<State> state;
    Slot* slot;
  };

  std::shared_ptr<State> state_;
  Release release_;
};

}  // namespace ktgp_orb::util
