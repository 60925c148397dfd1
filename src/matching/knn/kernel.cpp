// The inner loops of the search in plain C++, which serve as the reference for the vector kernels.
// The loops of the search in the whole image run over the lanes of a row, so that compilers can
// vectorise them.
#include "matching/knn/kernel.h"

#include <algorithm>
#include <array>
#include <cstring>

namespace ktgp_orb::knn {
namespace {

constexpr int kLanes = 32;
constexpr std::ptrdiff_t kRowBytes = std::ptrdiff_t{2} * kLanes;
constexpr std::ptrdiff_t kGroupBytes = kRowsPerGroup * kRowBytes;

/// A row of a group. Each word has two bytes: one for the first half of the group and one for the
/// second.
using Row = std::array<std::uint16_t, kLanes>;

Row load(const std::uint8_t* row) {
  Row words;
  std::memcpy(&words, row, sizeof(words));
  return words;
}

/// Counts the bits of each of the two bytes: adds neighbouring bits, then neighbouring pairs of
/// bits, then neighbouring nibbles.
std::uint16_t countBitsOfBytes(std::uint16_t v) {
  v = static_cast<std::uint16_t>(v - ((v >> 1) & 0x5555));
  v = static_cast<std::uint16_t>((v & 0x3333) + ((v >> 2) & 0x3333));
  return static_cast<std::uint16_t>((v + (v >> 4)) & 0x0f0f);
}

/// Sum of the distances over kRowsPerSum rows, beginning with row `first`.
Row sumRows(const std::uint8_t* group, int first, const std::uint8_t* descriptor) {
  Row sum{};
  for (int b = first; b < first + kRowsPerSum; ++b) {
    const Row row = load(group + b * kRowBytes);
    const auto query = static_cast<std::uint16_t>(descriptor[b] * 0x0101);
    for (int i = 0; i < kLanes; ++i) {
      sum[i] = static_cast<std::uint16_t>(
          sum[i] + countBitsOfBytes(static_cast<std::uint16_t>(row[i] ^ query)));
    }
  }
  return sum;
}

/// Updates the best two keys of every lane with the distances of one half group.
void addHalf(const Row& distance, const Row& number, LaneKeys& keys) {
  for (int i = 0; i < kLanes; ++i) {
    const auto key = static_cast<std::int16_t>((distance[i] << kKeyNumberBits) | number[i]);
    keys.second[i] = std::min(keys.second[i], std::max(keys.best[i], key));
    keys.best[i] = std::min(keys.best[i], key);
  }
}

/// Updates the nearest query of every candidate, for the search in the other direction.
void addQuery(const Row& distance, int query, std::int16_t* nearest_queries) {
  for (int i = 0; i < kLanes; ++i) {
    const auto key = static_cast<std::int16_t>((distance[i] << kKeyNumberBits) | query);
    nearest_queries[i] = std::min(nearest_queries[i], key);
  }
}

template <bool kBothWays>
void scanOne(const std::uint8_t* block, int group_count, const std::uint8_t* descriptor,
             [[maybe_unused]] int query, LaneKeys& result,
             [[maybe_unused]] std::int16_t* nearest_queries) {
  LaneKeys keys;
  std::fill_n(keys.best, kLanes, kNoKey);
  std::fill_n(keys.second, kLanes, kNoKey);
  for (int g = 0; g < group_count; ++g) {
    const std::uint8_t* group = block + g * kGroupBytes;
    const Row front = sumRows(group, 0, descriptor);
    const Row back = sumRows(group, kRowsPerSum, descriptor);
    Row even;
    Row odd;
    for (int i = 0; i < kLanes; ++i) {
      even[i] = static_cast<std::uint16_t>((front[i] & 0xff) + (back[i] & 0xff));
      odd[i] = static_cast<std::uint16_t>((front[i] >> 8) + (back[i] >> 8));
    }
    addHalf(even, load(group + kDescriptorBytes * kRowBytes), keys);
    addHalf(odd, load(group + (kDescriptorBytes + 1) * kRowBytes), keys);
    if constexpr (kBothWays) {
      addQuery(even, query, nearest_queries + std::ptrdiff_t{2} * g * kLanes);
      addQuery(odd, query, nearest_queries + (std::ptrdiff_t{2} * g + 1) * kLanes);
    }
  }
  result = keys;
}

template <bool kBothWays>
void scan(const std::uint8_t* block, int group_count, const QueryPass& queries, LaneKeys* keys,
          std::int16_t* nearest_queries) {
  for (int q = 0; q < kQueriesPerPass; ++q) {
    scanOne<kBothWays>(block, group_count, queries.descriptor[q], queries.first_number + q, keys[q],
                       nearest_queries);
  }
}

// Below are the functions for the search near predicted positions.

std::uint32_t byteCounts(std::uint32_t v) {
  v -= (v >> 1) & 0x55555555U;
  v = (v & 0x33333333U) + ((v >> 2) & 0x33333333U);
  return (v + (v >> 4)) & 0x0f0f0f0fU;
}

std::int32_t distanceTo(const std::uint32_t* query, const std::uint32_t* words,
                        std::ptrdiff_t stride) {
  std::uint32_t sums = 0;  // each byte is the sum of eight bit counts, at most 8 each
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

const KnnKernel& portableKnnKernel() {
  static constexpr KnnKernel kPortable{"portable", kLanes,        scan<false>,
                                       scan<true>, search<false>, search<true>};
  return kPortable;
}

}  // namespace ktgp_orb::knn
