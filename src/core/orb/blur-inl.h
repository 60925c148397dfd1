// The Gaussian blur with fused multiply-adds. No include guard: kernels_highway.cpp includes this
// once for each instruction set.
#include <hwy/highway.h>

#include "core/orb/kernels_common.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::ScalableTag<float>;
using Integers = hn::Rebind<std::int32_t, Floats>;
using FewBytes = hn::Rebind<std::uint8_t, Floats>;

HWY_INLINE hn::Vec<Floats> loadAsFloats(const std::uint8_t* pixel) {
  return hn::ConvertTo(Floats(), hn::PromoteTo(Integers(), hn::LoadU(FewBytes(), pixel)));
}

void blurAlongRow(const std::uint8_t* pixel, int count, float* out) {
  const Floats d;
  for (int x = 0; x < count; x += static_cast<int>(hn::Lanes(d))) {
    const std::uint8_t* p = pixel + x;
    auto sum = hn::Mul(hn::Set(d, kGaussian[3]), loadAsFloats(p - 3));
    sum = hn::MulAdd(hn::Set(d, kGaussian[2]), loadAsFloats(p - 2), sum);
    sum = hn::MulAdd(hn::Set(d, kGaussian[1]), loadAsFloats(p - 1), sum);
    sum = hn::MulAdd(hn::Set(d, kGaussian[0]), loadAsFloats(p), sum);
    sum = hn::MulAdd(hn::Set(d, kGaussian[1]), loadAsFloats(p + 1), sum);
    sum = hn::MulAdd(hn::Set(d, kGaussian[2]), loadAsFloats(p + 2), sum);
    sum = hn::MulAdd(hn::Set(d, kGaussian[3]), loadAsFloats(p + 3), sum);
    hn::StoreU(sum, d, out + x);
  }
}

void blurAcrossRows(const float* const* rows, int count, std::uint8_t* out) {
  const Floats d;
  const hn::RebindToUnsigned<Floats> du;
  const auto rounder = hn::Set(d, kRounder);
  for (int x = 0; x < count; x += static_cast<int>(hn::Lanes(d))) {
    const auto load = [&](int row) { return hn::LoadU(d, rows[row] + x); };
    auto sum = hn::Mul(hn::Set(d, kGaussian[0]), load(3));
    sum = hn::MulAdd(hn::Set(d, kGaussian[1]), hn::Add(load(4), load(2)), sum);
    sum = hn::MulAdd(hn::Set(d, kGaussian[2]), hn::Add(load(5), load(1)), sum);
    sum = hn::MulAdd(hn::Set(d, kGaussian[3]), hn::Add(load(6), load(0)), sum);
    const auto rounded = hn::And(hn::BitCast(du, hn::Add(sum, rounder)), hn::Set(du, 0xFF));
    hn::StoreU(hn::U8FromU32(rounded), FewBytes(), out + x);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb
HWY_AFTER_NAMESPACE();
