#pragma once

#include "util/highway_targets.h"

#include <hwy/targets.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace ktgp_orb::test {

/// Calls `visit` once for each instruction set of this processor, the best first, while run-time
/// dispatch is restricted to it.
template <typename Visit>
void forEachInstructionSet(const Visit& visit) {
  // Only sets for which this compiler makes code: GCC 10 does not know the newest ones. If dispatch
  // is restricted to one of these, it calls the code of the oldest set.
  std::int64_t left = hwy::SupportedTargets() & HWY_TARGETS;
  while (left != 0) {
    const std::int64_t target = left & -left;
    left -= target;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(target);
    visit();
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

/// All sets of kernels that this build and this processor support, the fastest first, the portable
/// one last. `best`: the function that chooses among them.
template <typename Kernels>
std::vector<const Kernels*> everyKernels(const Kernels& (*best)(), const Kernels& portable) {
  std::vector<const Kernels*> all;
  forEachInstructionSet([&] {
    const Kernels* chosen = &best();
    for (const Kernels* other : all) {
      if (other == chosen) return;
    }
    if (std::strcmp(chosen->name, portable.name) != 0) all.push_back(chosen);
  });
  all.push_back(&portable);
  return all;
}

}  // namespace ktgp_orb::test
