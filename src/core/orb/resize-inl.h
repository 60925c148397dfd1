// Linear interpolation in fixed point. No include guard: kernels_highway.cpp includes this once
// for each instruction set.
#include <hwy/highway.h>

#include "core/orb/kernels_common.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// One shuffle of 16 source pixels brings the left neighbours of eight target pixels into the lower
// half of the register and the right ones into the upper.
void resizeRow(const std::uint8_t* row, const ResizeBlock* blocks, int count, std::uint16_t* out) {
  const hn::FixedTag<std::uint8_t, 16> d8;
  const hn::FixedTag<std::uint16_t, 8> d16;
  const hn::Half<decltype(d8)> half;
  for (int i = 0; i < count; ++i) {
    const ResizeBlock& block = blocks[i];
    const auto pixels = hn::LoadU(d8, row + block.start);
    const auto taps = hn::TableLookupBytes(pixels, hn::LoadU(d8, block.taps));
    const auto left = hn::PromoteTo(d16, hn::LowerHalf(half, taps));
    const auto right = hn::PromoteTo(d16, hn::UpperHalf(half, taps));
    const auto sum =
        left * hn::LoadU(d16, block.weights) + right * hn::LoadU(d16, block.weights + kResizeBlock);
    hn::StoreU(sum, d16, out + static_cast<std::ptrdiff_t>(i) * kResizeBlock);
  }
}

void mixRows(const std::uint16_t* above, const std::uint16_t* below, int weight, int count,
             std::uint8_t* out) {
  const hn::ScalableTag<std::uint32_t> d32;
  const hn::Rebind<std::uint16_t, decltype(d32)> d16;
  const hn::Rebind<std::uint8_t, decltype(d32)> d8;
  const auto w0 = hn::Set(d32, static_cast<std::uint32_t>(256 - weight));
  const auto w1 = hn::Set(d32, static_cast<std::uint32_t>(weight));
  const auto half = hn::Set(d32, 1u << 15);
  for (int x = 0; x < count; x += static_cast<int>(hn::Lanes(d32))) {
    const auto a = hn::PromoteTo(d32, hn::LoadU(d16, above + x));
    const auto b = hn::PromoteTo(d32, hn::LoadU(d16, below + x));
    const auto sum = hn::ShiftRight<16>(a * w0 + b * w1 + half);
    hn::StoreU(hn::U8FromU32(sum), d8, out + x);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb
HWY_AFTER_NAMESPACE();
