#include "core/gms/kernels.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

#include "instruction_sets.h"

namespace ktgp_orb::gms {
namespace {

std::vector<const GmsKernels*> everyKernels() {
  return test::everyKernels(bestGmsKernels, portableGmsKernels());
}

class GmsKernelsTest : public testing::TestWithParam<const GmsKernels*> {};

TEST_P(GmsKernelsTest, SumsRangesOfEveryLength) {
  std::mt19937 random(1);
  std::vector<std::int32_t> steps(300);
  std::vector<std::int32_t> counts(300);
  for (std::int32_t& step : steps) step = static_cast<std::int32_t>(random() % 5) - 2;
  for (std::int32_t& count : counts) count = static_cast<std::int32_t>(random() % 100000);
  for (std::uint32_t n = 0; n <= 200; ++n) {
    const std::array<PairRange, 3> ranges{{{0, n}, {n / 2, n / 2}, {7, 7 + n / 3}}};
    for (std::int32_t step = -2; step <= 3; ++step) {
      std::int32_t expected = 0;
      for (std::uint32_t i = 0; i < n; ++i) {
        const int times = 1 + (i >= 7 && i < 7 + n / 3 ? 1 : 0);
        if (steps[i] == step) expected += times * counts[i];
      }
      for (std::uint32_t i = std::max(n, 7u); i < 7 + n / 3; ++i) {
        if (steps[i] == step) expected += counts[i];
      }
      ASSERT_EQ(GetParam()->sum_of_step(steps.data(), counts.data(), ranges, step), expected)
          << n << " entries, step " << step;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(EveryInstructionSet, GmsKernelsTest, testing::ValuesIn(everyKernels()),
                         [](const auto& tested) { return std::string(tested.param->name); });

}  // namespace
}  // namespace ktgp_orb::gms
