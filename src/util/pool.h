#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

namespace ktgp_orb::util {

/// Hands out objects, and takes each one back, with its buffers, when its last holder releases it.
///
/// A shared_ptr frees its control block when nobody holds it any more. Here the control block lies
/// beside the object. Freeing it tells the pool that the object is free, and no new block is
/// allocated. The lock orders the accesses of the last holder before the next ones; use_count()
/// would not.
template <typename T>
class Pool {
 public:
  using Release = void (*)(T&);

  /// `most`: number of free objects to keep. `release`: called in the thread of the last holder.
  Pool(std::size_t most, Release release) : state_(std::make_shared<State>()), release_(release) {
    state_->most = most;
    state_->free.reserve(most);
  }

  /// A new object, or a returned object with the content that it had when it was returned.
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

  /// Gives a shared_ptr the block of a slot as memory for its control block.
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
