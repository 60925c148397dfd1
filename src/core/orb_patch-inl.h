// What ORB computes from the patch around one keypoint: Harris response, orientation moments and
// descriptor. No include guard: orb_kernels_simd.cpp includes this once for each instruction set.
#include <hwy/highway.h>

#include <cstring>

#include "orb_kernels_common.h"
#include "orb_pattern.h"
#include "orb_patch_tables.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Sum of a[i] * b[i] over all lanes, in 32 bits.
template <class V>
HWY_INLINE std::int32_t dot(V a, V b) {
  const hn::RepartitionToWide<hn::DFromV<V>> d32;
  auto more = hn::Zero(d32);
  const auto sum = hn::ReorderWidenMulAccumulate(d32, a, b, hn::Zero(d32), more);
  return hn::GetLane(hn::SumOfLanes(d32, hn::Add(sum, more)));
}

// The seven columns of the block lie side by side in eight lanes; rows are taken one by one.
float harris(const std::uint8_t* pixel, std::ptrdiff_t stride) {
  const hn::FixedTag<std::int16_t, 8> d;
  const hn::Rebind<std::uint8_t, decltype(d)> d8;
  const hn::RepartitionToWide<decltype(d)> d32;
  const auto block = hn::FirstN(d, 2 * kHarrisRadius + 1);

  using V = hn::Vec<decltype(d)>;
  V change[9];  // right minus left neighbour
  V smooth[9];  // left + 2 * middle + right
  for (int i = 0; i < 9; ++i) {
    const std::uint8_t* p = pixel + (i - 4) * stride - kHarrisRadius;
    const auto left = hn::PromoteTo(d, hn::LoadU(d8, p - 1));
    const auto middle = hn::PromoteTo(d, hn::LoadU(d8, p));
    const auto right = hn::PromoteTo(d, hn::LoadU(d8, p + 1));
    change[i] = hn::IfThenElseZero(block, right - left);
    smooth[i] = hn::IfThenElseZero(block, left + right + middle + middle);
  }
  auto xx = hn::Zero(d32), yy = hn::Zero(d32), xy = hn::Zero(d32);
  auto xx1 = hn::Zero(d32), yy1 = hn::Zero(d32), xy1 = hn::Zero(d32);
  for (int i = 1; i < 8; ++i) {
    const auto dx = change[i - 1] + change[i] + change[i] + change[i + 1];
    const auto dy = smooth[i + 1] - smooth[i - 1];
    xx = hn::ReorderWidenMulAccumulate(d32, dx, dx, xx, xx1);
    yy = hn::ReorderWidenMulAccumulate(d32, dy, dy, yy, yy1);
    xy = hn::ReorderWidenMulAccumulate(d32, dx, dy, xy, xy1);
  }
  return harrisResponse(hn::GetLane(hn::SumOfLanes(d32, xx + xx1)),
                        hn::GetLane(hn::SumOfLanes(d32, yy + yy1)),
                        hn::GetLane(hn::SumOfLanes(d32, xy + xy1)));
}

// The columns of the disc lie side by side in lanes. Per column, the sum of I over the rows and the
// sum of y * I fit 16 bits: 31 * 255 and 120 * 255 at most.
Moments moments(const std::uint8_t* pixel, std::ptrdiff_t stride) {
  const hn::CappedTag<std::int16_t, kDiscColumns> d;
  const hn::Rebind<std::uint8_t, decltype(d)> d8;
  Moments result;
  for (int column = 0; column < kDiscColumns; column += static_cast<int>(hn::Lanes(d))) {
    const std::uint8_t* centre = pixel + column - kOrientationRadius;
    const auto load = [&](int y) {
      const auto disc = hn::LoadU(d8, kDiscTable.rows[std::abs(y)] + column);
      return hn::PromoteTo(d, hn::And(disc, hn::LoadU(d8, centre + y * stride)));
    };
    auto sum = load(0);
    auto sum_y = hn::Zero(d);
    for (int y = 1; y <= kOrientationRadius; ++y) {
      const auto below = load(y);
      const auto above = load(-y);
      sum = sum + below + above;
      sum_y = sum_y + (below - above) * hn::Set(d, static_cast<std::int16_t>(y));
    }
    result.x += dot(sum, hn::LoadU(d, kDiscTable.x + column));
    result.y += dot(sum_y, hn::Set(d, 1));
  }
  return result;
}

// Offsets of pattern points after rotation. The order of the roundings is part of the definition:
// each product, their sum, then to the nearest pixel.
struct Rotation {
  using D = hn::ScalableTag<float>;
  hn::Vec<D> cosine, sine;
  hn::Vec<hn::RebindToSigned<D>> stride;

  HWY_INLINE auto operator()(const float* pattern_x, const float* pattern_y) const {
    const auto x = hn::Load(D(), pattern_x);
    const auto y = hn::Load(D(), pattern_y);
    const auto column = hn::NearestInt(hn::Sub(hn::Mul(x, cosine), hn::Mul(y, sine)));
    const auto row = hn::NearestInt(hn::Add(hn::Mul(x, sine), hn::Mul(y, cosine)));
    return row * stride + column;
  }
};

void describe(const std::uint8_t* pixel, std::ptrdiff_t stride, float cosine, float sine,
              std::uint8_t* descriptor) {
  const hn::ScalableTag<float> d;
  const hn::RebindToSigned<decltype(d)> di;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const Rotation rotate{hn::Set(d, cosine), hn::Set(d, sine),
                        hn::Set(di, static_cast<std::int32_t>(stride))};
  const auto* base = reinterpret_cast<const std::int32_t*>(pixel);
  const auto sample = [&](const float* x, const float* y) {
    return hn::And(hn::GatherOffset(di, base, rotate(x, y)), hn::Set(di, 0xFF));
  };
  std::uint8_t bits[8] = {};
  for (int i = 0; i < kPatternPairs; i += lanes) {
    const auto first = sample(kPatternTable.first_x + i, kPatternTable.first_y + i);
    const auto second = sample(kPatternTable.second_x + i, kPatternTable.second_y + i);
    hn::StoreMaskBits(di, first < second, bits);
    if (lanes >= 8) {
      std::memcpy(descriptor + i / 8, bits, static_cast<std::size_t>(lanes) / 8);
    } else {
      const int shift = i % 8;
      if (shift == 0) descriptor[i / 8] = 0;
      descriptor[i / 8] |= static_cast<std::uint8_t>(bits[0] << shift);
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb
HWY_AFTER_NAMESPACE();
