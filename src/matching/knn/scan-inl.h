// The inner loop of the search in the whole image. It has no include guard, because dispatch.cpp
// includes it once for each instruction set.
#include <hwy/highway.h>

#include <cstddef>

#include "matching/knn/kernel.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::knn {
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

// AVX-512 with BITALG, and Arm, have an instruction that counts the bits of each byte.
#if HWY_TARGET <= HWY_AVX3_DL || HWY_ARCH_ARM

/// The descriptor of a query. Each of its bytes is repeated across a row.
class Query {
 public:
  void set(const std::uint8_t* descriptor) {
    for (int b = 0; b < kDescriptorBytes; ++b) {
      hn::Store(hn::Set(kBytes, descriptor[b]), kBytes, rows_[b]);
    }
  }

  /// Number of bits that differ between byte `b` of the query and byte `b` of the candidates, which
  /// is in `row`.
  Bytes distance(int b, Bytes row) const {
    return hn::PopulationCount(hn::Xor(row, hn::Load(kBytes, rows_[b])));
  }

 private:
  alignas(kRowBytes) std::uint8_t rows_[kDescriptorBytes][kRowBytes];
};

#else

/// The descriptor of a query. The bits are counted by look-up in a table of sixteen entries, which
/// fits in a register. For a nibble n of the query, entry i of the table is the number of bits set
/// in i ^ n, so the look-up includes the exclusive or.
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

  /// Number of bits that differ between byte `b` of the query and byte `b` of the candidates, which
  /// is in `row`.
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

/// Sum of the distances over kRowsPerSum rows, beginning with row `first`, for every query.
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

/// Updates the best two keys of each query with the distances of one half group. `distances` has
/// one row per query.
HWY_INLINE void addHalf(const Words* distances, const std::uint8_t* number_row, BestTwo* best_two) {
  const Words number = hn::Load(kWords, reinterpret_cast<const std::uint16_t*>(number_row));
  for (int q = 0; q < kQueriesPerPass; ++q) {
    const Words distance = hn::ShiftLeft<kKeyNumberBits>(distances[q]);
    best_two[q].add(hn::BitCast(kKeys, hn::Or(distance, number)));
  }
}

/// Updates the nearest query of each candidate, for the search in the other direction.
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
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::knn
HWY_AFTER_NAMESPACE();
