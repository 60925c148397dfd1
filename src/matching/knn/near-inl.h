// The inner loop of the search near predicted positions. It has no include guard, because
// dispatch.cpp includes it once for each instruction set.
#include <hwy/highway.h>

#include <cstring>

#include "matching/knn/kernel.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::knn {
namespace HWY_NAMESPACE {
namespace near {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

const hn::CappedTag<std::int32_t, kMaxNearLanes> kKeys;
const hn::Repartition<std::uint32_t, decltype(kKeys)> kWords;
const hn::Repartition<std::uint8_t, decltype(kKeys)> kBytes;
const hn::Repartition<float, decltype(kKeys)> kFloats;
using Keys = hn::Vec<decltype(kKeys)>;
using Words = hn::Vec<decltype(kWords)>;

constexpr std::uint32_t kLanes =
    HWY_LANES(std::int32_t) < kMaxNearLanes ? HWY_LANES(std::int32_t) : kMaxNearLanes;

/// Hamming distances between the query and a vector of candidates whose descriptors begin at
/// `words`.
HWY_INLINE Words distances(const Words (&query)[kDescriptorWords],
                           const std::uint32_t* HWY_RESTRICT words, std::ptrdiff_t stride) {
// These processors have an instruction that counts the bits of a word.
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3_DL
  Words sum = hn::Zero(kWords);
  for (int w = 0; w < kDescriptorWords; ++w) {
    const Words row = hn::LoadU(kWords, words + w * stride);
    sum = hn::Add(sum, hn::PopulationCount(hn::Xor(row, query[w])));
  }
  return sum;
#else
  auto bytes = hn::Zero(kBytes);  // each byte is the sum of eight bit counts, at most 8 each
  for (int w = 0; w < kDescriptorWords; ++w) {
    const Words row = hn::LoadU(kWords, words + w * stride);
    bytes = hn::Add(bytes, hn::PopulationCount(hn::BitCast(kBytes, hn::Xor(row, query[w]))));
  }
  const Words sums = hn::BitCast(kWords, bytes);
  const Words low_bytes = hn::Set(kWords, 0x00ff00ffU);
  const Words pairs =
      hn::Add(hn::And(sums, low_bytes), hn::And(hn::ShiftRight<8>(sums), low_bytes));
  return hn::Add(hn::And(pairs, hn::Set(kWords, 0xffffU)), hn::ShiftRight<16>(pairs));
#endif
}

/// Reduces the keys of all lanes to the best two keys.
HWY_INLINE NearKeys reduce(Keys best, Keys second) {
  const Keys smallest = hn::MinOfLanes(kKeys, best);
  // All keys differ, except kNoNearKey, so the smallest key is in one lane only.
  const Keys others = hn::IfThenElse(hn::Eq(best, smallest), second, best);
  return {hn::GetLane(smallest), hn::GetLane(hn::MinOfLanes(kKeys, others))};
}

template <bool kBothWays>
NearKeys search(const NearCandidates& candidates, const NearQuery& query,
                [[maybe_unused]] std::int32_t* HWY_RESTRICT nearest_queries) {
  std::uint32_t words[kDescriptorWords];
  std::memcpy(words, query.descriptor, kDescriptorBytes);
  Words spread[kDescriptorWords];
  for (int w = 0; w < kDescriptorWords; ++w) spread[w] = hn::Set(kWords, words[w]);
  const auto x = hn::Set(kFloats, query.x);
  const auto y = hn::Set(kFloats, query.y);
  const auto squared_radius = hn::Set(kFloats, query.squared_radius);
  const Keys none = hn::Set(kKeys, kNoNearKey);
  Keys best = none;
  Keys second = none;
  for (const NearRun* run = query.runs; run != query.runs + query.run_count; ++run) {
    for (std::uint32_t i = run->begin; i < run->end; i += kLanes) {
      const Keys distance =
          hn::BitCast(kKeys, hn::ShiftLeft<kNearIndexBits>(
                                 distances(spread, candidates.words + i, candidates.stride)));
      const auto dx = hn::Sub(hn::LoadU(kFloats, candidates.x + i), x);
      const auto dy = hn::Sub(hn::LoadU(kFloats, candidates.y + i), y);
      const auto near = hn::Le(hn::Add(hn::Mul(dx, dx), hn::Mul(dy, dy)), squared_radius);
      const auto inside = hn::And(hn::RebindMask(kKeys, near), hn::FirstN(kKeys, run->end - i));
      const Keys key =
          hn::IfThenElse(inside, hn::Or(distance, hn::LoadU(kKeys, candidates.index + i)), none);
      second = hn::Min(second, hn::Max(best, key));
      best = hn::Min(best, key);
      if constexpr (kBothWays) {
        const Keys reverse =
            hn::IfThenElse(inside, hn::Or(distance, hn::Set(kKeys, query.number)), none);
        const Keys nearest = hn::LoadU(kKeys, nearest_queries + i);
        hn::StoreU(hn::Min(nearest, reverse), kKeys, nearest_queries + i);
      }
    }
  }
  return reduce(best, second);
}

}  // namespace
}  // namespace near
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::knn
HWY_AFTER_NAMESPACE();
