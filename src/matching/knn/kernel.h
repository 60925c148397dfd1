#pragma once

#include <cstddef>
#include <cstdint>

#include "ktgp_orb/features.h"

namespace ktgp_orb::knn {

// The inner loop of the search in the whole image. Each instruction set has its own kernel.
// Candidates (reference descriptors) are in the lanes of vectors, so one instruction processes the
// same byte of many candidates:
//
//   group    2 * lanes candidates: 32 rows, then two rows of 16-bit candidate numbers. Row b holds
//            byte b of each candidate. Even bytes of a row belong to the first half of the group's
//            candidates, odd bytes to the second half. So a mask and a shift are enough to widen a
//            row of bytes to two rows of 16 bits.
//   block    at most kGroupsPerBlock groups, because the number in a key has only 6 bits
//   key      distance << 6 | number of the half group in its block, in a 16-bit lane. Of two keys,
//            the smaller belongs to the nearer candidate or, at equal distances, to the candidate
//            with the lower index. Min and max keep the best two keys of every lane without a
//            branch.
//
// The search in the other direction finds the nearest query of each candidate. It uses the same
// distances, so it costs only one more minimum per distance. Instead of the half group, its keys
// contain the number of the query in its chunk.

constexpr int kKeyNumberBits = 6;
constexpr int kGroupsPerBlock = (1 << kKeyNumberBits) / 2;
/// The key for "no candidate", above all other keys. It is also the candidate number of the padding
/// lanes of the last group, because any key combined with it by "or" is kNoKey again.
constexpr std::int16_t kNoKey = 32767;
/// Number of rows of a group: a row for each descriptor byte, then the candidate numbers of both
/// halves.
constexpr int kRowsPerGroup = kDescriptorBytes + 2;
/// Number of rows whose distances can be summed in a byte: at most 8 bits differ in a row, so the
/// sum over 16 rows is at most 128.
constexpr int kRowsPerSum = kDescriptorBytes / 2;
/// Number of queries per pass over a block. Each row is read and split only once for all queries of
/// a pass.
constexpr int kQueriesPerPass = 4;
/// Maximum number of queries in a chunk, since a key must hold the number of the query in its
/// chunk.
constexpr int kMaxQueriesPerChunk = 1 << kKeyNumberBits;
/// Number of 16-bit lanes of the widest kernel (512 bits).
constexpr int kMaxLanes = 32;

/// The descriptors of the queries of a pass, 32 bytes each, with any alignment.
struct QueryPass {
  const std::uint8_t* descriptor[kQueriesPerPass];
  /// Number of the first query in its chunk; the other queries have the next numbers.
  int first_number;
};

/// The best two keys in every lane, found for one query.
struct LaneKeys {
  alignas(64) std::int16_t best[kMaxLanes];
  alignas(64) std::int16_t second[kMaxLanes];
};

// The inner loop of the search near predicted positions. Each instruction set has its own kernel.
// The candidates of a query lie in a few runs of neighbouring columns (NearRun). Each query has its
// own candidates, only a few dozen, so queries cannot share rows as above. Lanes have 32 bits here.
// A vector holds the same word of several descriptors, one in each lane; a descriptor has eight
// words. The arrays x, y and index of the candidates have the same layout. Candidates outside the
// radius get no key.
//
//   key   distance << kNearIndexBits | index in the frame. Of two keys, the smaller belongs to the
//         nearer candidate or, at equal distances, to the candidate with the lower index. The
//         order of the candidates does not matter.

constexpr int kDescriptorWords = kDescriptorBytes / 4;
constexpr int kNearIndexBits = 22;
/// Largest number of keypoints in a frame.
constexpr int kMaxNearFeatures = 1 << kNearIndexBits;
/// The key for "no candidate", above all other keys.
constexpr std::int32_t kNoNearKey = 0x7fffffff;
/// Number of 32-bit lanes of the widest kernel (512 bits). Kernels may read this many entries past
/// the end of a run.
constexpr int kMaxNearLanes = 16;

/// The candidates as columns of arrays, sorted by their position in the image.
struct NearCandidates {
  const std::uint32_t* words;  ///< word w of the descriptor of candidate i is words[w * stride + i]
  std::ptrdiff_t stride;
  const float* x;  ///< px
  const float* y;
  const std::int32_t* index;  ///< number of the keypoint in the frame
};

/// The candidates with the numbers [begin, end).
struct NearRun {
  std::uint32_t begin;
  std::uint32_t end;
};

struct NearQuery {
  const std::uint8_t* descriptor;  ///< descriptor, 32 bytes of any alignment
  float x;                         ///< centre of the search circle, px
  float y;
  float squared_radius;
  std::int32_t number;  ///< number of the query in its frame
  const NearRun* runs;
  int run_count;
};

/// The best two keys among the candidates within the search circle. Candidate i is inside if
/// (x_i - x)^2 + (y_i - y)^2 <= squared_radius, where (x, y) is the centre. Each operation of this
/// test is rounded to single precision, so that all kernels agree.
struct NearKeys {
  std::int32_t best;
  std::int32_t second;
};

struct KnnKernel {
  /// Searches the first `group_count` groups of `block` (64-byte aligned) for the queries of a
  /// pass. `keys` has kQueriesPerPass entries; the function writes the first `lanes` lanes of each
  /// entry. `nearest_queries`: see scan_both_ways.
  using Scan = void (*)(const std::uint8_t* block, int group_count, const QueryPass& queries,
                        LaneKeys* keys, std::int16_t* nearest_queries);
  /// Searches the candidates for one query. `nearest_queries`: see search_both_ways.
  using Search = NearKeys (*)(const NearCandidates& candidates, const NearQuery& query,
                              std::int32_t* nearest_queries);

  const char* name;  ///< instruction set, e.g. "AVX2"
  int lanes;         ///< number of 16-bit lanes; a row has twice this number of bytes
  Scan scan;         ///< ignores `nearest_queries`
  /// Like `scan`, but also updates `nearest_queries` (64-byte aligned): for each candidate, the key
  /// of its nearest query.
  Scan scan_both_ways;
  Search search;  ///< searches near a position; ignores `nearest_queries`
  /// Like `search`, but also updates `nearest_queries`: for each candidate, the key of its nearest
  /// query. These keys contain the number of the query in place of the index.
  Search search_both_ways;
};

/// Returns the kernel in plain C++, which is the reference for the other kernels.
const KnnKernel& portableKnnKernel();
/// Returns the fastest kernel that this build and this processor support.
const KnnKernel& bestKnnKernel();

}  // namespace ktgp_orb::knn
