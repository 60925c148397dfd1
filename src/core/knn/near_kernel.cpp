// The search near predicted positions in plain C++, the reference for the vector kernels.
#include "core/knn/near_kernel.h"

#include <algorithm>
#include <cstring>

namespace ktgp_orb::knn {
namespace {

/// Bits set in each byte of `v`.
std::uint32_t byteCounts(std::uint32_t v) {
  v -= (v >> 1) & 0x55555555U;
  v = (v & 0x33333333U) + ((v >> 2) & 0x33333333U);
  return (v + (v >> 4)) & 0x0f0f0f0fU;
}

std::int32_t distanceTo(const std::uint32_t* query, const std::uint32_t* words,
                        std::ptrdiff_t stride) {
  std::uint32_t sums = 0;  // each byte counts at most eight times eight
  for (int w = 0; w < kDescriptorWords; ++w) sums += byteCounts(query[w] ^ words[w * stride]);
  sums = (sums & 0x00ff00ffU) + ((sums >> 8) & 0x00ff00ffU);
  return static_cast<std::int32_t>((sums & 0xffffU) + (sums >> 16));
}

template <bool kBothWays>
NearKeys search(const NearCandidates& candidates, const NearQuery& query,
                [[maybe_unused]] std::int32_t* nearest_queries) {
  std::uint32_t words[kDescriptorWords];
  std::memcpy(words, query.descriptor, kDescriptorBytes);
  NearKeys keys{kNoNearKey, kNoNearKey};
  for (const NearRun* run = query.runs; run != query.runs + query.run_count; ++run) {
    for (std::uint32_t i = run->begin; i < run->end; ++i) {
      const float dx = candidates.x[i] - query.x;
      const float dy = candidates.y[i] - query.y;
      const float xx = dx * dx;
      const float yy = dy * dy;
      if (!(xx + yy <= query.squared_radius)) continue;
      const std::int32_t distance = distanceTo(words, candidates.words + i, candidates.stride)
                                    << kNearIndexBits;
      const std::int32_t key = distance | candidates.index[i];
      keys.second = std::min(keys.second, std::max(keys.best, key));
      keys.best = std::min(keys.best, key);
      if constexpr (kBothWays) {
        nearest_queries[i] = std::min(nearest_queries[i], distance | query.number);
      }
    }
  }
  return keys;
}

}  // namespace

const NearKernel& portableNearKernel() {
  static constexpr NearKernel kPortable{"portable", search<false>, search<true>};
  return kPortable;
}

}  // namespace ktgp_orb::knn
