#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>

#include "core/orb/detector.h"
#include "core/util/constants.h"

namespace ktgp_orb {
namespace {

using orb::vectorAngle;
using util::kPi;

/// Calls visit(y, x) with integer vectors of all lengths, like the moments of a patch.
template <typename Visit>
void forEachVector(const Visit& visit) {
  std::uint64_t state = 1;
  const auto next = [&](int bits) {
    state = state * 6364136223846793005U + 1442695040888963407U;
    return static_cast<float>(static_cast<std::int32_t>(state >> 32) >> (32 - bits));
  };
  for (int i = 0; i < 200000; ++i) {
    const int bits = 4 + i % 20;
    const float y = next(bits);
    visit(y, next(bits));
  }
}

TEST(VectorAngle, IsTheArcTangent) {
  forEachVector([](float y, float x) {
    if (x == 0.f && y == 0.f) return;
    const double exact = std::atan2(y, x) * 180 / kPi;
    const double difference = std::abs(vectorAngle(y, x) - (exact < 0 ? exact + 360 : exact));
    EXPECT_LT(difference, 0.012) << y << ", " << x;
  });
}

TEST(VectorAngle, IsExactOnTheAxes) {
  EXPECT_EQ(vectorAngle(0.f, 0.f), 0.f);
  EXPECT_EQ(vectorAngle(0.f, 5.f), 0.f);
  EXPECT_EQ(vectorAngle(5.f, 0.f), 90.f);
  EXPECT_EQ(vectorAngle(0.f, -5.f), 180.f);
  EXPECT_EQ(vectorAngle(-5.f, 0.f), 270.f);
}

// FNV-1a of all bits, recorded on x86-64. Fused multiply-adds would change it.
TEST(VectorAngle, HasTheSameBitsEverywhere) {
  std::uint64_t hash = 0xcbf29ce484222325U;
  forEachVector([&](float y, float x) {
    const float angle = vectorAngle(y, x);
    std::uint32_t bits;
    std::memcpy(&bits, &angle, sizeof bits);
    hash = (hash ^ bits) * 0x100000001b3U;
  });
  EXPECT_EQ(hash, 0x2d315b563cc708c2U);
}

#if defined(__x86_64__)
TEST(VectorAngle, IsThatOfOpencv) {
  forEachVector([](float y, float x) { EXPECT_EQ(vectorAngle(y, x), cv::fastAtan2(y, x)); });
}
#endif

}  // namespace
}  // namespace ktgp_orb
