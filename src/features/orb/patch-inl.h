// Harris response, orientation moments and descriptor of the patch around one keypoint. No include
// guard: dispatch.cpp includes this once for each instruction set.
#include <hwy/highway.h>

#include <cstring>

#include "features/orb/kernels_common.h"
#include "features/orb/pattern.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::orb {
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

// Each of the seven columns of the block has a lane (the eighth lane is not used); rows are
// processed one by one.
float harris(const std::uint8_t* pixel, std::ptrdiff_t stride) {
  const hn::FixedTag<std::int16_t, 8> d;
  const hn::Rebind<std::uint8_t, decltype(d)> d8;
  const hn::RepartitionToWide<decltype(d)> d32;
  const auto block = hn::FirstN(d, 2 * kHarrisRadius + 1);

  using V = hn::Vec<decltype(d)>;
  V change[9];  // for each row: right neighbour minus left neighbour
  V smooth[9];  // for each row: left + 2 * middle + right
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

// Each lane holds a column of the disc. For each column, the sum of the intensities I over the rows
// is at most 31 * 255 and the sum of y * I at most 120 * 255, so both fit into 16 bits.
std::pair<int, int> moments(const std::uint8_t* pixel, std::ptrdiff_t stride) {
  const hn::CappedTag<std::int16_t, kDiscColumns> d;
  const hn::Rebind<std::uint8_t, decltype(d)> d8;
  int moment_x = 0;
  int moment_y = 0;
  for (int column = 0; column < kDiscColumns; column += static_cast<int>(hn::Lanes(d))) {
    const std::uint8_t* centre = pixel + column - kOrientationRadius;
    const auto load = [&](int y) {
      const auto disc = hn::LoadU(d8, kDisc[std::abs(y)].data() + column);
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
    const auto first = hn::Set(d, static_cast<std::int16_t>(column - kOrientationRadius));
    // Iota(d, first) would be slow, because `first` is a variable.
    moment_x += dot(sum, hn::Iota(d, 0) + first);
    moment_y += dot(sum_y, hn::Set(d, 1));
  }
  return {moment_x, moment_y};
}

using Coordinates = hn::ScalableTag<float>;
using Offsets = hn::RebindToSigned<Coordinates>;

// The rotated sampling pattern, as byte offsets in an image with a given stride.
class PatternRotation {
 public:
  HWY_INLINE PatternRotation(float cosine, float sine, std::ptrdiff_t stride)
      : cosine_(hn::Set(Coordinates(), cosine)),
        sine_(hn::Set(Coordinates(), sine)),
        stride_(hn::Set(Offsets(), static_cast<std::int32_t>(stride))),
        surplus_(hn::Set(
            Offsets(),
            static_cast<std::int32_t>(kRounderBits * (static_cast<std::uint32_t>(stride) + 1U)))) {}

  // Byte offsets of the pattern's points from point `i` on. The order of the roundings is part of
  // the descriptor's definition: first each product is rounded, then the sum, then the pixel
  // position.
  HWY_INLINE hn::Vec<Offsets> offsets(int i) const {
    const Coordinates d;
    const auto rounder = hn::Set(d, kRounder);
    const auto x = hn::Load(d, kPatternX + i);
    const auto y = hn::Load(d, kPatternY + i);
    const auto column = hn::Add(hn::Sub(hn::Mul(x, cosine_), hn::Mul(y, sine_)), rounder);
    const auto row = hn::Add(hn::Add(hn::Mul(x, sine_), hn::Mul(y, cosine_)), rounder);
    return hn::BitCast(Offsets(), row) * stride_ + hn::BitCast(Offsets(), column) - surplus_;
  }

 private:
  hn::Vec<Coordinates> cosine_;
  hn::Vec<Coordinates> sine_;
  hn::Vec<Offsets> stride_;
  // kRounderBits * (stride + 1). It is subtracted from row * stride + column (mod 2^32), because
  // row and column still contain kRounderBits.
  hn::Vec<Offsets> surplus_;
};

// Computes the descriptor by reading the pixels one by one.
void describe(const std::uint8_t* pixel, std::ptrdiff_t stride, float cosine, float sine,
              std::uint8_t* descriptor) {
  alignas(64) std::int32_t offsets[2 * kPatternPairs];
  const PatternRotation rotation(cosine, sine, stride);
  for (int i = 0; i < 2 * kPatternPairs; i += static_cast<int>(hn::Lanes(Offsets()))) {
    hn::Store(rotation.offsets(i), Offsets(), offsets + i);
  }
  const std::int32_t* first = offsets;
  const std::int32_t* second = offsets + kPatternPairs;
  for (int byte = 0; byte < kPatternPairs / 8; ++byte, first += 8, second += 8) {
    unsigned bits = 0;
    for (int i = 7; i >= 0; --i) {
      bits = 2 * bits + static_cast<unsigned>(pixel[first[i]] < pixel[second[i]]);
    }
    descriptor[byte] = static_cast<std::uint8_t>(bits);
  }
}

#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3_DL
HWY_INLINE hn::Vec<Offsets> gatherPixels(const std::uint8_t* pixel, hn::Vec<Offsets> offsets) {
  const auto* base = reinterpret_cast<const std::int32_t*>(pixel);
  return hn::And(hn::GatherOffset(Offsets(), base, offsets), hn::Set(Offsets(), 0xFF));
}

// Gathers 16 pixels with one instruction, which also reads three bytes beyond each pixel.
void describeByGathers(const std::uint8_t* pixel, std::ptrdiff_t stride, float cosine, float sine,
                       std::uint8_t* descriptor) {
  const PatternRotation rotation(cosine, sine, stride);
  for (int i = 0; i < kPatternPairs; i += static_cast<int>(hn::Lanes(Offsets()))) {
    const auto first = gatherPixels(pixel, rotation.offsets(i));
    const auto second = gatherPixels(pixel, rotation.offsets(kPatternPairs + i));
    std::uint8_t bits[8];
    const std::size_t bytes = hn::StoreMaskBits(Offsets(), hn::Lt(first, second), bits);
    std::memcpy(descriptor + i / 8, bits, bytes);
  }
}
#endif

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::orb
HWY_AFTER_NAMESPACE();
