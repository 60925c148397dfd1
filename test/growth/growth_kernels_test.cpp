// The inner loops of the growth and of the targets: every instruction set gives the same numbers.
#include <gtest/gtest.h>

#include <array>
#include <random>
#include <string>
#include <vector>

#include "growth/alike_kernel.h"
#include "instruction_sets.h"
#include "targets/vote_kernel.h"

namespace ktgp_orb {
namespace {

std::string nameOf(const testing::TestParamInfo<const growth::AlikeKernel*>& info) {
  return info.param->name;
}

class AlikeKernelTest : public testing::TestWithParam<const growth::AlikeKernel*> {};

TEST_P(AlikeKernelTest, FindsKeypointsThatAreNearAndAlike) {
  constexpr std::uint32_t kCount = 60;
  std::mt19937 random(1);
  std::uniform_real_distribution<float> place(0.F, 30.F), turn(0.F, 6.2832F), size(2.F, 5.F);
  constexpr std::size_t kPitch = kCount + growth::kReadBeyond;
  std::vector<float> columns(growth::kLocalFrameValues * kPitch);
  std::size_t found = 0, near = 0;
  for (int round = 0; round < 500; ++round) {
    for (std::size_t i = 0; i < kCount; ++i) {
      const float angle = turn(random);
      const std::array<float, 5> values{place(random), place(random), std::cos(angle),
                                        std::sin(angle), size(random)};
      for (std::size_t c = 0; c < 5; ++c) columns[c * kPitch + i] = values[c];
    }
    const float angle = turn(random);
    const growth::LocalFrame predicted{place(random), place(random), std::cos(angle),
                                       std::sin(angle), size(random)};
    const float squared_radius = place(random) * 5;
    const std::uint32_t begin = random() % 20;
    const std::uint32_t end = begin + random() % (kCount - begin);
    std::vector<std::uint32_t> expected(kCount), alike(kCount);
    bool any_expected = false, any = false;
    const auto find = [&](const growth::AlikeKernel& kernel, std::vector<std::uint32_t>& numbers,
                          bool& is_near) {
      numbers.resize(kernel.find(columns.data(), kPitch, begin, end, predicted, squared_radius,
                                 numbers.data(), is_near));
    };
    find(growth::portableAlikeKernel(), expected, any_expected);
    find(*GetParam(), alike, any);
    ASSERT_EQ(alike, expected) << begin << " to " << end;
    ASSERT_EQ(any, any_expected);
    for (const std::uint32_t i : alike) {
      const auto value = [&](std::size_t c) { return columns[c * kPitch + i]; };
      ASSERT_LT(std::hypot(value(0) - predicted.x, value(1) - predicted.y),
                std::sqrt(squared_radius) + 1e-3F);
      const float cosine = value(2) * predicted.dx + value(3) * predicted.dy;
      ASSERT_LT(std::acos(std::min(cosine, 1.F)), 0.601F);
      ASSERT_LT(std::exp(std::abs(value(4) - predicted.log_size)), 1.801F);
    }
    found += alike.size();
    near += any ? 1 : 0;
  }
  EXPECT_GT(found, 100U);
  EXPECT_GT(near, 100U);
  EXPECT_LT(near, 500U);
}

INSTANTIATE_TEST_SUITE_P(EveryInstructionSet, AlikeKernelTest,
                         testing::ValuesIn(test::everyKernels(growth::bestAlikeKernel,
                                                              growth::portableAlikeKernel())),
                         nameOf);

class VoteKernelTest : public testing::TestWithParam<const targets::VoteKernel*> {};

targets::SeedMap seedAt(float x, float y, float scale) {
  // The map of this seed is a similarity with this scale.
  return {x,     y,   scale * x, scale * y, 2.F * std::log(scale),
          scale, 0.F, 0.F,       scale,     scale * std::sqrt(2.F)};
}

TEST_P(VoteKernelTest, CountsVotersThatAgree) {
  using targets::kSeedMapValues;
  using targets::SeedMap;
  std::mt19937 random(2);
  std::uniform_real_distribution<float> place(0.F, 300.F), noise(-1.F, 1.F);
  std::size_t total = 0;
  for (std::size_t count = 0; count < 100; ++count) {
    const std::size_t pitch = count + targets::kReadBeyond;
    // Values beyond the last voter would agree.
    const SeedMap seed = seedAt(150.F, 150.F, 0.8F);
    const SeedMap same = seedAt(170.F, 150.F, 0.8F);
    std::vector<SeedMap> voters(pitch, same);
    for (std::size_t i = 0; i < count; ++i) {
      SeedMap& voter = voters[i];
      voter = seedAt(place(random), place(random), std::exp(0.8F * noise(random)));
      voter.to_x = 0.8F * voter.from_x + 20.F * noise(random);
      voter.to_y = 0.8F * voter.from_y + 20.F * noise(random);
      voter.xy = 0.7F * noise(random);
    }
    std::vector<float> columns(kSeedMapValues * pitch);
    for (std::size_t i = 0; i < pitch; ++i) {
      const SeedMap& v = voters[i];
      const float values[kSeedMapValues] = {v.from_x, v.from_y, v.to_x, v.to_y, v.log_area,
                                            v.xx,     v.xy,     v.yx,   v.yy,   v.norm};
      for (std::size_t c = 0; c < kSeedMapValues; ++c) columns[c * pitch + i] = values[c];
    }
    std::int32_t expected = 0;
    for (std::size_t i = 0; i < count; ++i) expected += targets::agrees(voters[i], seed) ? 1 : 0;
    ASSERT_EQ(GetParam()->votes(columns.data(), pitch, count, seed), expected) << count;
    total += static_cast<std::size_t>(expected);
  }
  EXPECT_GT(total, 200U);
}

TEST_P(VoteKernelTest, EachConditionCounts) {
  using targets::SeedMap;
  const SeedMap seed = seedAt(100.F, 100.F, 1.F);
  const auto votesOf = [&](const SeedMap& voter) {
    std::vector<float> columns;
    for (const float value : {voter.from_x, voter.from_y, voter.to_x, voter.to_y, voter.log_area,
                              voter.xx, voter.xy, voter.yx, voter.yy, voter.norm}) {
      columns.push_back(value);
      columns.resize(columns.size() + targets::kReadBeyond);
    }
    return GetParam()->votes(columns.data(), 1 + targets::kReadBeyond, 1, seed);
  };
  const SeedMap right = seedAt(140.F, 100.F, 1.F);
  EXPECT_EQ(votesOf(right), 1);
  EXPECT_EQ(votesOf(seedAt(251.F, 100.F, 1.F)), 0);  // too far
  EXPECT_EQ(votesOf(seedAt(107.F, 100.F, 1.F)), 0);  // too near
  SeedMap wrong = right;
  wrong.log_area = 1.F;
  EXPECT_EQ(votesOf(wrong), 0);
  wrong = right;
  wrong.to_y += 11.F;  // 10.8 are allowed at a distance of 40
  EXPECT_EQ(votesOf(wrong), 0);
  wrong = right;
  wrong.to_x = 103.F;
  EXPECT_EQ(votesOf(wrong), 0);
  wrong = right;
  wrong.xx = wrong.yy = 0.5F;  // turned by 60 degrees
  wrong.xy = -0.866F;
  wrong.yx = 0.866F;
  EXPECT_EQ(votesOf(wrong), 0);
}

INSTANTIATE_TEST_SUITE_P(EveryInstructionSet, VoteKernelTest,
                         testing::ValuesIn(test::everyKernels(targets::bestVoteKernel,
                                                              targets::portableVoteKernel())),
                         [](const auto& tested) { return std::string(tested.param->name); });

}  // namespace
}  // namespace ktgp_orb
