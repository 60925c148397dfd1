#pragma once

#include <array>
#include <cstdint>

namespace ktgp_orb::gms {

/// Consecutive cell pairs, from `begin` up to but not including `end`.
struct PairRange {
  std::uint32_t begin;
  std::uint32_t end;
};

/// Entries past the last pair that the kernels may read.
constexpr int kReadBeyond = 8;

/// The inner loop of GMS without rotation, one per instruction set; all give the same sums.
struct GmsKernels {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// Sum of counts[i] over all i of the ranges with steps[i] == `step`.
  std::int32_t (*sum_of_step)(const std::int32_t* steps, const std::int32_t* counts,
                              const std::array<PairRange, 3>& ranges, std::int32_t step);
};

/// Plain C++, the reference for the other sets.
const GmsKernels& portableGmsKernels();
/// The fastest set that this build and this processor support.
const GmsKernels& bestGmsKernels();

}  // namespace ktgp_orb::gms
