// Vector kernels, compiled once per instruction set by foreach_target.h.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/knn/kernel_highway.cpp"
// Highway leaves out AVX-512 with BITALG and VPOPCNTDQ (Ice Lake, Zen 4) unless it is asked for.
#define HWY_WANT_AVX3_DL 1
// SVE's vectors of unknown size do not fit arrays, and processors that have it have NEON as well.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)
// clang-format off
#include <hwy/foreach_target.h>  // before highway.h
#include <hwy/highway.h>
// clang-format on

#include <cstddef>

#include "core/knn/kernel.h"

// Without vectors the portable kernel is the better one.
#if HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128
HWY_BEFORE_NAMESPACE();
namespace ktgp_orb {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

const hn::CappedTag<std::uint8_t, 2 * kMaxLanes> kBytes;
const hn::Repartition<std::uint16_t, decltype(kBytes)> kWords;
const hn::Repartition<std::int16_t, decltype(kBytes)> kKeys;
using Bytes = hn::Vec<decltype(kBytes)>;
using Words = hn::Vec<decltype(kWords)>;
using Keys = hn::Vec<decltype(kKeys)>;

constexpr std::ptrdiff_t kRowBytes = HWY_LANES(std::uint8_t);
constexpr int kLanes = HWY_LANES(std::int16_t);
constexpr std::ptrdiff_t kGroupBytes = kRowsPerGroup * kRowBytes;

#if HWY_TARGET <= HWY_AVX3_DL || HWY_TARGET == HWY_NEON

/// One target descriptor. Every byte of it is laid out across a row, because there is an
/// instruction that counts the bits of each byte.
class Query {
 public:
  void set(const std::uint8_t* descriptor) {
    for (int b = 0; b < kDescriptorBytes; ++b) {
      hn::Store(hn::Set(kBytes, descriptor[b]), kBytes, rows_[b]);
    }
  }

  /// Distances between byte `b` and that of the candidates in `row`.
  Bytes distance(int b, Bytes row) const {
    return hn::PopulationCount(hn::Xor(row, hn::Load(kBytes, rows_[b])));
  }

 private:
  alignas(kRowBytes) std::uint8_t rows_[kDescriptorBytes][kRowBytes];
};

#else

/// One target descriptor. Bits are counted by table, sixteen entries in a register: entry i of the
/// table of a nibble n is the number of bits set in i ^ n, which saves the exclusive or as well.
class Query {
 public:
  void set(const std::uint8_t* descriptor) {
    const hn::CappedTag<std::uint8_t, 16> table;
    alignas(16) constexpr std::uint8_t kBitCount[16] = {0, 1, 1, 2, 1, 2, 2, 3,
                                                        1, 2, 2, 3, 2, 3, 3, 4};
    const auto bit_count = hn::Load(table, kBitCount);
    const auto entry = hn::Iota(table, 0);
    for (int b = 0; b < kDescriptorBytes; ++b) {
      const auto low = hn::Set(table, static_cast<std::uint8_t>(descriptor[b] & 15));
      const auto high = hn::Set(table, static_cast<std::uint8_t>(descriptor[b] >> 4));
      hn::Store(hn::TableLookupBytes(bit_count, hn::Xor(entry, low)), table, low_[b]);
      hn::Store(hn::TableLookupBytes(bit_count, hn::Xor(entry, high)), table, high_[b]);
    }
  }

  /// Distances between byte `b` and that of the candidates in `row`.
  Bytes distance(int b, Bytes row) const {
    const Bytes nibble = hn::Set(kBytes, 15);
    const Bytes low = hn::And(row, nibble);
    const Bytes high =
        hn::And(hn::BitCast(kBytes, hn::ShiftRight<4>(hn::BitCast(kWords, row))), nibble);
    return hn::Add(hn::TableLookupBytes(hn::LoadDup128(kBytes, low_[b]), low),
                   hn::TableLookupBytes(hn::LoadDup128(kBytes, high_[b]), high));
  }

 private:
  alignas(16) std::uint8_t low_[kDescriptorBytes][16];
  alignas(16) std::uint8_t high_[kDescriptorBytes][16];
};

#endif

/// Sums of the distances in kRowsPerSum rows from `first`, for every query.
HWY_INLINE void sumRows(const std::uint8_t* group, int first, const Query* queries, Bytes* sums) {
  for (int q = 0; q < kQueriesPerPass; ++q) sums[q] = hn::Zero(kBytes);
  HWY_UNROLL(4)
  for (int b = first; b < first + kRowsPerSum; ++b) {
    const Bytes row = hn::Load(kBytes, group + b * kRowBytes);
    for (int q = 0; q < kQueriesPerPass; ++q) {
      sums[q] = hn::Add(sums[q], queries[q].distance(b, row));
    }
  }
}

/// The best two keys of every lane so far.
struct BestTwo {
  Keys best;
  Keys second;

  BestTwo() : best(hn::Set(kKeys, kNoKey)), second(best) {}

  HWY_INLINE void add(Keys key) {
    second = hn::Min(second, hn::Max(best, key));
    best = hn::Min(best, key);
  }
};

/// Takes the distances of one half group, one row for each query, into the best two of the queries.
HWY_INLINE void addHalf(const Words* distances, const std::uint8_t* number_row, BestTwo* best_two) {
  const Words number = hn::Load(kWords, reinterpret_cast<const std::uint16_t*>(number_row));
  for (int q = 0; q < kQueriesPerPass; ++q) {
    const Words distance = hn::ShiftLeft<kKeyNumberBits>(distances[q]);
    best_two[q].add(hn::BitCast(kKeys, hn::Or(distance, number)));
  }
}

/// The other way round: into the nearest query of each candidate.
HWY_INLINE void addQueries(const Words* distances, int first_number,
                           std::int16_t* HWY_RESTRICT nearest_queries) {
  Keys nearest = hn::Load(kKeys, nearest_queries);
  for (int q = 0; q < kQueriesPerPass; ++q) {
    const Words distance = hn::ShiftLeft<kKeyNumberBits>(distances[q]);
    const Words query = hn::Set(kWords, static_cast<std::uint16_t>(first_number + q));
    nearest = hn::Min(nearest, hn::BitCast(kKeys, hn::Or(distance, query)));
  }
  hn::Store(nearest, kKeys, nearest_queries);
}

template <bool kBothWays>
void scan(const std::uint8_t* HWY_RESTRICT block, int group_count, const QueryPass& pass,
          LaneKeys* HWY_RESTRICT keys,
          [[maybe_unused]] std::int16_t* HWY_RESTRICT nearest_queries) {
  Query queries[kQueriesPerPass];
  BestTwo best_two[kQueriesPerPass];
  for (int q = 0; q < kQueriesPerPass; ++q) queries[q].set(pass.descriptor[q]);
  const Words low_byte = hn::Set(kWords, 0xff);
  for (int g = 0; g < group_count; ++g) {
    const std::uint8_t* group = block + g * kGroupBytes;
    Bytes front[kQueriesPerPass];
    Bytes back[kQueriesPerPass];
    sumRows(group, 0, queries, front);
    sumRows(group, kRowsPerSum, queries, back);
    Words even[kQueriesPerPass];
    Words odd[kQueriesPerPass];
    for (int q = 0; q < kQueriesPerPass; ++q) {
      const Words f = hn::BitCast(kWords, front[q]);
      const Words b = hn::BitCast(kWords, back[q]);
      even[q] = hn::Add(hn::And(f, low_byte), hn::And(b, low_byte));
      odd[q] = hn::Add(hn::ShiftRight<8>(f), hn::ShiftRight<8>(b));
    }
    const std::uint8_t* numbers = group + kDescriptorBytes * kRowBytes;
    addHalf(even, numbers, best_two);
    addHalf(odd, numbers + kRowBytes, best_two);
    if constexpr (kBothWays) {
      std::int16_t* nearest = nearest_queries + std::ptrdiff_t{2} * g * kLanes;
      addQueries(even, pass.first_number, nearest);
      addQueries(odd, pass.first_number, nearest + kLanes);
    }
  }
  for (int q = 0; q < kQueriesPerPass; ++q) {
    hn::Store(best_two[q].best, kKeys, keys[q].best);
    hn::Store(best_two[q].second, kKeys, keys[q].second);
  }
}

}  // namespace

KnnKernel knnKernel() {
  return {hwy::TargetName(HWY_TARGET), kLanes, &scan<false>, &scan<true>};
}

}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb
HWY_AFTER_NAMESPACE();
#endif

#if HWY_ONCE
namespace ktgp_orb {

std::vector<KnnKernel> highwayKnnKernels() {
  std::vector<KnnKernel> kernels;
  const auto add_if_supported = [&](std::int64_t target, KnnKernel (*kernel)()) {
    if ((hwy::SupportedTargets() & target) != 0) kernels.push_back(kernel());
  };
#if HWY_TARGETS & HWY_AVX3_DL
  add_if_supported(HWY_AVX3_DL, N_AVX3_DL::knnKernel);
#endif
#if HWY_TARGETS & HWY_AVX3
  add_if_supported(HWY_AVX3, N_AVX3::knnKernel);
#endif
#if HWY_TARGETS & HWY_AVX2
  add_if_supported(HWY_AVX2, N_AVX2::knnKernel);
#endif
#if HWY_TARGETS & HWY_SSE4
  add_if_supported(HWY_SSE4, N_SSE4::knnKernel);
#endif
#if HWY_TARGETS & HWY_NEON
  add_if_supported(HWY_NEON, N_NEON::knnKernel);
#endif
  return kernels;
}

}  // namespace ktgp_orb
#endif
