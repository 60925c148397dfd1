// The Gaussian blur with fused multiply-adds. No include guard: dispatch.cpp includes this
// once for each instruction set.
#include <hwy/highway.h>

#include "features/orb/kernels_common.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::orb {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Words = hn::ScalableTag<std::uint32_t>;
using Floats = hn::Rebind<float, Words>;
using Integers = hn::RebindToSigned<Words>;
using Bytes8 = hn::Repartition<std::uint8_t, Words>;

// Pixels are processed as words of four bytes. A register of words is split into four registers:
// the first bytes of all words, the second bytes, and so on. Splitting and joining words is cheaper
// than widening and narrowing bytes.
constexpr int kPixelsPerWord = 4;

template <int kByte>
HWY_INLINE hn::Vec<Floats> byteOf(hn::Vec<Words> words) {
  const auto byte = hn::And(hn::ShiftRight<8 * kByte>(words), hn::Set(Words(), 0xFF));
  return hn::ConvertTo(Floats(), hn::BitCast(Integers(), byte));
}

HWY_INLINE hn::Vec<Words> loadWords(const std::uint8_t* pixel) {
  return hn::BitCast(Words(), hn::LoadU(Bytes8(), pixel));
}

// p[0..6]: the pixels at the distances -3..3 from the blurred pixel.
HWY_INLINE hn::Vec<Floats> weightedSum(const hn::Vec<Floats>* p) {
  const Floats d;
  auto sum = hn::Mul(hn::Set(d, kGaussian[3]), p[0]);
  sum = hn::MulAdd(hn::Set(d, kGaussian[2]), p[1], sum);
  sum = hn::MulAdd(hn::Set(d, kGaussian[1]), p[2], sum);
  sum = hn::MulAdd(hn::Set(d, kGaussian[0]), p[3], sum);
  sum = hn::MulAdd(hn::Set(d, kGaussian[1]), p[4], sum);
  sum = hn::MulAdd(hn::Set(d, kGaussian[2]), p[5], sum);
  return hn::MulAdd(hn::Set(d, kGaussian[3]), p[6], sum);
}

void blurAlongRow(const std::uint8_t* pixel, int count, float* out) {
  const Floats d;
  const auto lanes = static_cast<int>(hn::Lanes(d));
  for (int x = 0; x < count; x += kPixelsPerWord * lanes) {
    const auto before = loadWords(pixel + x - kPixelsPerWord);
    const auto words = loadWords(pixel + x);
    const auto after = loadWords(pixel + x + kPixelsPerWord);
    const hn::Vec<Floats> p[] = {byteOf<1>(before), byteOf<2>(before), byteOf<3>(before),
                                 byteOf<0>(words),  byteOf<1>(words),  byteOf<2>(words),
                                 byteOf<3>(words),  byteOf<0>(after),  byteOf<1>(after),
                                 byteOf<2>(after)};
    for (int byte = 0; byte < kPixelsPerWord; ++byte) {
      hn::StoreU(weightedSum(p + byte), d, out + x + byte * lanes);
    }
  }
}

HWY_INLINE hn::Vec<Words> blurredByte(const float* const* rows, int at) {
  const Floats d;
  const auto load = [&](int row) { return hn::LoadU(d, rows[row] + at); };
  auto sum = hn::Mul(hn::Set(d, kGaussian[0]), load(3));
  sum = hn::MulAdd(hn::Set(d, kGaussian[1]), hn::Add(load(4), load(2)), sum);
  sum = hn::MulAdd(hn::Set(d, kGaussian[2]), hn::Add(load(5), load(1)), sum);
  sum = hn::MulAdd(hn::Set(d, kGaussian[3]), hn::Add(load(6), load(0)), sum);
  return hn::And(hn::BitCast(Words(), hn::Add(sum, hn::Set(d, kRounder))), hn::Set(Words(), 0xFF));
}

void blurAcrossRows(const float* const* rows, int count, std::uint8_t* out) {
  const auto lanes = static_cast<int>(hn::Lanes(Floats()));
  for (int x = 0; x < count; x += kPixelsPerWord * lanes) {
    const auto low = hn::Or(blurredByte(rows, x), hn::ShiftLeft<8>(blurredByte(rows, x + lanes)));
    const auto high = hn::Or(hn::ShiftLeft<16>(blurredByte(rows, x + 2 * lanes)),
                             hn::ShiftLeft<24>(blurredByte(rows, x + 3 * lanes)));
    hn::StoreU(hn::BitCast(Bytes8(), hn::Or(low, high)), Bytes8(), out + x);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::orb
HWY_AFTER_NAMESPACE();
