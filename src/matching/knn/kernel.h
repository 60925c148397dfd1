#pragma once

#include <cstddef>
#include <cstdint>

#include "ktgp_orb/features.h"

namespace ktgp_orb::knn {

// The inner loop of the search, one per instruction set. Candidates (reference descriptors) are in
// the lanes of vectors, so one instruction processes the same byte of many candidates:
//
//   group    2 * lanes candidates: 32 rows, row b holding byte b of each of them, then two rows of
//            16-bit candidate numbers. Even bytes of a row belong to the first half of the group's
//            candidates, odd ones to the second, so that a row of bytes widens to two rows of 16
//            bits by a mask and a shift.
//   block    at most kGroupsPerBlock groups, as many as a key can number
//   key      distance << 6 | half group within its block, in a 16-bit lane: the smaller key has the
//            nearer candidate or, at equal distance, the lower index. Min and max keep the best two
//            keys of every lane without a branch.
//
// The other direction, each candidate's nearest query, uses the same distances. Its keys contain
// the number of the query in its chunk in place of the half group. This direction takes one more
// minimum per candidate.

constexpr int kKeyNumberBits = 6;
constexpr int kGroupsPerBlock = (1 << kKeyNumberBits) / 2;
/// The key for "no candidate", above all others. It is also the candidate number of the padding
/// lanes of the last group: or'ed into any key, the result stays this key.
constexpr std::int16_t kNoKey = 32767;
/// Number of rows of a group: descriptor bytes, then the candidate numbers of both halves.
constexpr int kRowsPerGroup = kDescriptorBytes + 2;
/// Number of rows whose distances, at most 8 each, can be summed in a byte.
constexpr int kRowsPerSum = kDescriptorBytes / 2;
/// Number of queries per pass over a block; they share every row that is read and split.
constexpr int kQueriesPerPass = 4;
/// Number of queries that the keys of one chunk can number.
constexpr int kMaxQueriesPerChunk = 1 << kKeyNumberBits;
/// 16-bit lanes of the widest kernel (512 bits).
constexpr int kMaxLanes = 32;

/// The queries of a pass: 32 bytes each, of any alignment.
struct QueryPass {
  const std::uint8_t* descriptor[kQueriesPerPass];
  int first_number;  ///< number of the first query in its chunk; the others follow
};

/// The best two keys of every lane, for one query.
struct LaneKeys {
  alignas(64) std::int16_t best[kMaxLanes];
  alignas(64) std::int16_t second[kMaxLanes];
};

// The inner loop of the search near predicted positions, one per instruction set. Each query has
// its own candidates, some dozens in a few runs, which is too few to share rows as above. Lanes
// have 32 bits here. A vector holds word w, one of eight, of as many descriptors as it has lanes;
// x, y and index of the candidates have the same layout. Candidates outside the radius get no key.
//
//   key   distance << kNearIndexBits | index in the frame: the smaller key has the nearer candidate
//         or, at equal distance, the lower index, whatever the order of the candidates.

constexpr int kDescriptorWords = kDescriptorBytes / 4;
constexpr int kNearIndexBits = 22;
/// Largest number of keypoints in a frame.
constexpr int kMaxNearFeatures = 1 << kNearIndexBits;
/// The key for "no candidate", above all others.
constexpr std::int32_t kNoNearKey = 0x7fffffff;
/// 32-bit lanes of the widest kernel (512 bits); kernels may read this many lanes past a run.
constexpr int kMaxNearLanes = 16;

/// The candidates as columns, sorted by their position in the image.
struct NearCandidates {
  const std::uint32_t* words;  ///< word w of candidate i: words[w * stride + i]
  std::ptrdiff_t stride;
  const float* x;  ///< px
  const float* y;
  const std::int32_t* index;  ///< number of the keypoint in the frame
};

/// Candidates [begin, end).
struct NearRun {
  std::uint32_t begin;
  std::uint32_t end;
};

struct NearQuery {
  const std::uint8_t* descriptor;  ///< 32 bytes of any alignment
  float x;                         ///< centre of the circle, px
  float y;
  float squared_radius;
  std::int32_t number;  ///< number of the query in its frame
  const NearRun* runs;
  int run_count;
};

/// The best two keys among the candidates with (x_i - x)^2 + (y_i - y)^2 <= squared_radius, in
/// single precision, each operation rounded.
struct NearKeys {
  std::int32_t best;
  std::int32_t second;
};

struct KnnKernel {
  /// Searches the first `group_count` groups of `block` (64-byte aligned) for the queries of a
  /// pass. `keys` has kQueriesPerPass entries; the first `lanes` lanes of each are written.
  /// `nearest_queries`: see scan_both_ways.
  using Scan = void (*)(const std::uint8_t* block, int group_count, const QueryPass& queries,
                        LaneKeys* keys, std::int16_t* nearest_queries);
  /// `nearest_queries`: see search_both_ways.
  using Search = NearKeys (*)(const NearCandidates& candidates, const NearQuery& query,
                              std::int32_t* nearest_queries);

  const char* name;     ///< instruction set, e.g. "AVX2"
  int lanes;            ///< 16-bit lanes; a row has twice as many bytes
  Scan scan;            ///< ignores `nearest_queries`
  Scan scan_both_ways;  ///< also lowers the keys `nearest_queries` (64-byte aligned), by candidate
  Search search;        ///< near a position; ignores `nearest_queries`
  Search search_both_ways;  ///< also lowers the keys `nearest_queries`, by candidate; they have the
                            ///< number of the query in place of the index
};

/// Plain C++, the reference for the other kernels.
const KnnKernel& portableKnnKernel();
/// The fastest kernel that this build and this processor support.
const KnnKernel& bestKnnKernel();

}  // namespace ktgp_orb::knn
