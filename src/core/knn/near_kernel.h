#pragma once

#include <cstddef>
#include <cstdint>

#include "ktgp_orb/features.h"

namespace ktgp_orb::knn {

// The inner loop of the search near predicted positions, one per instruction set. Each query has
// its own candidates, some dozens in a few runs: too few to share the rows of kernel.h. A lane has
// 32 bits here: word w of as many descriptors as there are lanes, eight words per descriptor, then
// the positions of the candidates. Candidates outside the radius get no key.
//
//   key   distance << kNearIndexBits | index in the frame: the smaller key is the nearer candidate
//         and, at equal distance, the one with the lower index, in any order of the candidates.

constexpr int kDescriptorWords = kDescriptorBytes / 4;
constexpr int kNearIndexBits = 22;
/// Largest number of keypoints in a frame.
constexpr int kMaxNearFeatures = 1 << kNearIndexBits;
/// The key for "no candidate", above all others.
constexpr std::int32_t kNoNearKey = 0x7fffffff;
/// 32-bit lanes of the widest kernel (512 bits); the kernels may read so many lanes past a run.
constexpr int kMaxNearLanes = 16;

/// The candidates as columns, sorted by their position in the image.
struct NearCandidates {
  const std::uint32_t* words;  ///< word w of candidate i: words[w * stride + i]
  std::ptrdiff_t stride;
  const float* x;  ///< px
  const float* y;
  const std::int32_t* index;  ///< in the frame
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
  std::int32_t number;  ///< in its frame
  const NearRun* runs;
  int run_count;
};

/// The best two keys among the candidates with (x_i - x)^2 + (y_i - y)^2 <= squared_radius, in
/// single precision, each operation rounded.
struct NearKeys {
  std::int32_t best;
  std::int32_t second;
};

struct NearKernel {
  /// `nearest_queries`: see search_both_ways.
  using Search = NearKeys (*)(const NearCandidates& candidates, const NearQuery& query,
                              std::int32_t* nearest_queries);

  const char* name;         ///< instruction set, e.g. "AVX2"
  Search search;            ///< ignores `nearest_queries`
  Search search_both_ways;  ///< also lowers `nearest_queries`: one key per candidate, with the
                            ///< number of the query in place of the index
};

/// Plain C++, the reference for the other kernels.
const NearKernel& portableNearKernel();
/// The fastest kernel that this build and this processor support.
const NearKernel& bestNearKernel();

}  // namespace ktgp_orb::knn
