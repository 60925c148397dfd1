#pragma once

#include <cstdint>
#include <vector>

#include "input.h"
#include "instruction_sets.h"

namespace ktgp_orb::fuzz {

/// During its lifetime, run-time dispatch is restricted to one instruction set of this processor,
/// which the input chooses; all inputs together try all of them. They are listed once, since a
/// virtual processor answers this query slowly.
class OneInstructionSet {
 public:
  explicit OneInstructionSet(Input& in) {
    const std::vector<std::int64_t>& all = each();
    use(all[in.ConsumeIntegralInRange<std::size_t>(0, all.size() - 1)]);
  }
  ~OneInstructionSet() {
    std::int64_t all = 0;
    for (const std::int64_t target : each()) all |= target;
    use(all);
  }
  OneInstructionSet(const OneInstructionSet&) = delete;
  OneInstructionSet& operator=(const OneInstructionSet&) = delete;

 private:
  static const std::vector<std::int64_t>& each() {
    static const std::vector<std::int64_t> all = [] {
      std::vector<std::int64_t> targets;
      for (std::int64_t left = hwy::SupportedTargets() & HWY_TARGETS; left != 0; left &= left - 1) {
        targets.push_back(left & -left);
      }
      return targets;
    }();
    return all;
  }
  static void use(std::int64_t targets) {
    hwy::SetSupportedTargetsForTest(targets);
    hwy::GetChosenTarget().Update(targets);
  }
};

}  // namespace ktgp_orb::fuzz
