#pragma once

#include <shared_mutex>

namespace ktgp_orb {

/// OpenCV's thread pool: there is one in a process, and its size must not change while anyone is
/// using it.
class OpencvPool {
 public:
  /// Limits the pool to `threads`, 0: all cores, once nobody uses it. The last limit counts.
  static void limit(int threads);

  /// Held by whoever calls OpenCV.
  class Use {
   public:
    Use();

   private:
    std::shared_lock<std::shared_mutex> lock_;
  };
};

}  // namespace ktgp_orb
