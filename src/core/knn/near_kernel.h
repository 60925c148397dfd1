#pragma once

#include <cstddef>
#include <cstdint>

#include "ktgp_orb/features.h"

namespace ktgp_orb::knn {

// The inner loop of the search by place, one per instruction set. Each query has candidates of its
// own, some dozens in a few runs, too few to share the rows of kernel.h. Here a lane has 32 bits:
// word w of as many descriptors as there are lanes, eight words a descriptor, and then the
// candidates' places, of which those outside the radius leave no key.
//
//   key   distance << kNearIndexBits | index in the frame: the smaller key is the nearer candidate
//         and, at equal distance, the one with the lower index, whatever order they come in.

constexpr int kDescriptorWords = kDescriptorBytes / 4;
constexpr int kNearIndexBits = 22;
/// Keypoints that a frame may have.
constexpr int kMaxNearFeatures = 1 << kNearIndexBits;
/// The key of no candidate, above all others.
constexpr std::int32_t kNoNearKey = 0x7fffffff;
/// 32-bit lanes of the widest kernel (512 bits); so much is read beyond the end of a run.
constexpr int kMaxNearLanes = 16;

/// The candidates, as columns: what lies together in the image lies together here.
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
  float x;                         ///< the middle of the circle, px
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
  Search search_both_ways;  ///< lowers `nearest_queries`: a key for each candidate, with the number
                            ///< of the query in place of the index
};

/// Plain C++, the definition of what the others compute.
const NearKernel& portableNearKernel();
/// The fastest that this build has and this processor runs.
const NearKernel& bestNearKernel();

}  // namespace ktgp_orb::knn
