// The inner loop of GMS in plain C++, the reference for the vector versions.
#include "core/gms/kernels.h"

namespace ktgp_orb::gms {
namespace {

std::int32_t sumOfStep(const std::int32_t* steps, const std::int32_t* counts,
                       const std::array<PairRange, 3>& ranges, std::int32_t step) {
  std::int32_t sum = 0;
  for (const PairRange& range : ranges) {
    for (std::uint32_t i = range.begin; i < range.end; ++i) {
      sum += steps[i] == step ? counts[i] : 0;
    }
  }
  return sum;
}

}  // namespace

const GmsKernels& portableGmsKernels() {
  static constexpr GmsKernels kPortable{"portable", sumOfStep};
  return kPortable;
}

}  // namespace ktgp_orb::gms
