#include "main.h"

#include "util/highway_targets.h"

#include <benchmark/benchmark.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <string>

namespace ktgp_orb::bench {
namespace {

/// Takes the option out of the arguments. Kernels are chosen when they are first used, so this
/// comes before everything else.
bool limitInstructionSet(int& argc, char** argv) {
  const std::string option = "--instruction_set=";
  char** const end = argv + argc;
  char** const found =
      std::find_if(argv, end, [&](const std::string& text) { return text.rfind(option, 0) == 0; });
  if (found == end) return true;
  const std::string name = std::string(*found).substr(option.size());
  std::copy(found + 1, end, found);
  --argc;

  std::string names;
  for (std::int64_t left = hwy::SupportedTargets() & HWY_TARGETS; left != 0; left &= left - 1) {
    const std::int64_t target = left & -left;
    names += std::string(names.empty() ? "" : ", ") + hwy::TargetName(target);
    if (name != hwy::TargetName(target)) continue;
    hwy::DisableTargets(target - 1);  // the better a target is, the lower its bit
    return true;
  }
  std::fprintf(stderr, "--instruction_set %s: this processor has %s\n", name.c_str(),
               names.c_str());
  return false;
}

}  // namespace

int run(int argc, char** argv, void (*registerMore)()) {
  if (!limitInstructionSet(argc, argv)) return 2;
  if (registerMore != nullptr) registerMore();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}

}  // namespace ktgp_orb::bench
