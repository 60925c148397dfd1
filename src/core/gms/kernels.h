#pragma once

#include <array>
#include <cstdint>

namespace ktgp_orb::gms {

/// Cell pairs beside each other in memory, from `begin` up to but not including `end`.
struct PairRange {
  std::uint32_t begin;
  std::uint32_t end;
};

/// Entries beyond the last pair that the kernels may read.
constexpr int kReadBeyond = 8;

/// The inner loop of GMS without rotation. One per instruction set; all give the same sums.
struct GmsKernels {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// Sum of counts[i] over the i of all ranges for which steps[i] is `step`.
  std::int32_t (*sum_of_step)(const std::int32_t* steps, const std::int32_t* counts,
                              const std::array<PairRange, 3>& ranges, std::int32_t step);
};

/// Plain C++, the definition of what the others compute.
const GmsKernels& portableGmsKernels();
/// The fastest that this build has and this processor runs.
const GmsKernels& bestGmsKernels();

}  // namespace ktgp_orb::gms
