// Linear interpolation in fixed point. No include guard: dispatch.cpp includes this once
// for each instruction set.
#include <hwy/highway.h>

#include "features/orb/kernels_common.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::orb {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// One shuffle of 16 source pixels moves the left neighbours of eight target pixels into the lower
// half of the register, and the right neighbours into the upper half.
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

// The products have 24 bits. One multiplication gives their upper 16 bits. A second multiplication
// gives the lower 8 bits (in the upper half of a lane); we need only their carry.
void mixRows(const std::uint16_t* above, const std::uint16_t* below, int weight, int count,
             std::uint8_t* out) {
  // If one of the weights is 0, the other row is interpolated with itself, so that both weights fit
  // into 8 bits.
  if (weight == 0) below = above;
  if (weight == 256) above = below;
  if (above == below) weight = 1;
  const hn::ScalableTag<std::uint16_t> d;
  const hn::RebindToSigned<decltype(d)> d_signed;
  const hn::Rebind<std::uint8_t, decltype(d)> d8;
  const auto w0 = hn::Set(d, static_cast<std::uint16_t>((256 - weight) << 8));
  const auto w1 = hn::Set(d, static_cast<std::uint16_t>(weight << 8));
  const auto half = hn::Set(d, 128);
  for (int x = 0; x < count; x += static_cast<int>(hn::Lanes(d))) {
    const auto a = hn::LoadU(d, above + x);
    const auto b = hn::LoadU(d, below + x);
    const auto carry = hn::ShiftRight<15>(hn::AverageRound(a * w0, b * w1));
    const auto sum = hn::MulHigh(a, w0) + hn::MulHigh(b, w1) + half + carry;
    const auto mixed = hn::BitCast(d_signed, hn::ShiftRight<8>(sum));
    hn::StoreU(hn::DemoteTo(d8, mixed), d8, out + x);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::orb
HWY_AFTER_NAMESPACE();
