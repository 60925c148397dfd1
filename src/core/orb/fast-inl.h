// FAST-9 and non-maximum suppression, a register of pixels at a time. No include guard:
// kernels_highway.cpp includes this once for each instruction set.
#include <hwy/highway.h>

#include <cstring>

#include "core/orb/kernels_common.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Bytes = hn::ScalableTag<std::uint8_t>;
using ByteVector = hn::Vec<Bytes>;

struct Least {
  HWY_INLINE ByteVector operator()(ByteVector a, ByteVector b) const { return hn::Min(a, b); }
};
struct Greatest {
  HWY_INLINE ByteVector operator()(ByteVector a, ByteVector b) const { return hn::Max(a, b); }
};

// With Inner = Least, Outer = Greatest: the largest grey value that some arc of nine neighbours
// reaches everywhere; swapped: the smallest that some arc stays below.
//
// The arcs that start at an even neighbour and at the one after it share the eight in between:
// best(inner(eight, first), inner(eight, last)) = inner(eight, best(first, last)).
template <class Inner, class Outer>
HWY_INLINE ByteVector bestArc(const ByteVector (&p)[16], Inner inner, Outer outer) {
  ByteVector two[8];
  for (int i = 0; i < 8; ++i) two[i] = inner(p[2 * i + 1], p[(2 * i + 2) % 16]);
  ByteVector four[8];
  for (int i = 0; i < 8; ++i) four[i] = inner(two[i], two[(i + 1) % 8]);
  ByteVector nine[8];
  for (int i = 0; i < 8; ++i) {
    const ByteVector eight = inner(four[i], four[(i + 2) % 8]);
    nine[i] = inner(eight, outer(p[2 * i], p[(2 * i + 9) % 16]));
  }
  for (int step = 4; step > 0; step /= 2) {
    for (int i = 0; i < step; ++i) nine[i] = outer(nine[i], nine[i + step]);
  }
  return nine[0];
}

// Any arc of nine contains two neighbouring points of the compass; without such a pair that
// differs enough no pixel here is a corner.
HWY_INLINE bool mayHoldCorner(ByteVector south, ByteVector east, ByteVector north, ByteVector west,
                              ByteVector centre, ByteVector threshold) {
  const auto brightest = hn::Min(hn::Max(south, north), hn::Max(east, west));
  const auto darkest = hn::Max(hn::Min(south, north), hn::Min(east, west));
  const auto contrast = hn::Max(hn::SaturatedSub(brightest, centre),  //
                                hn::SaturatedSub(centre, darkest));
  return !hn::AllFalse(Bytes(), contrast > threshold);
}

HWY_INLINE ByteVector cornerScores(const std::uint8_t* pixel, const std::ptrdiff_t (&circle)[16],
                                   ByteVector threshold) {
  const Bytes d;
  const auto centre = hn::LoadU(d, pixel);
  ByteVector p[16];
  for (int i = 0; i < 16; i += 4) p[i] = hn::LoadU(d, pixel + circle[i]);
  if (!mayHoldCorner(p[0], p[4], p[8], p[12], centre, threshold)) return hn::Zero(d);
  for (int i = 0; i < 16; ++i) {
    if (i % 4 != 0) p[i] = hn::LoadU(d, pixel + circle[i]);
  }
  const auto brighter = hn::SaturatedSub(bestArc(p, Least(), Greatest()), centre);
  const auto darker = hn::SaturatedSub(centre, bestArc(p, Greatest(), Least()));
  const auto contrast = hn::Max(brighter, darker);
  return hn::IfThenElseZero(contrast > threshold, hn::SaturatedSub(contrast, hn::Set(d, 1)));
}

void fastScores(const std::uint8_t* pixel, std::ptrdiff_t stride, int count, int threshold,
                std::uint8_t* scores) {
  const Bytes d;
  const auto t = hn::Set(d, static_cast<std::uint8_t>(threshold));
  std::ptrdiff_t circle[16];
  for (int i = 0; i < 16; ++i) circle[i] = kFastCircle[i].y * stride + kFastCircle[i].x;
  for (int x = 0; x < count; x += static_cast<int>(hn::Lanes(d))) {
    hn::StoreU(cornerScores(pixel + x, circle, t), d, scores + x);
  }
}

HWY_INLINE std::uint64_t maskBits(hn::Mask<Bytes> mask) {
  alignas(8) std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(Bytes(), mask, bytes);
  std::uint64_t bits;
  std::memcpy(&bits, bytes, sizeof(bits));
  return bits;
}

int localMaxima(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below,
                int count, std::int32_t* maxima) {
  const Bytes d;
  const auto lanes = static_cast<int>(hn::Lanes(d));
  const auto load = [d](const std::uint8_t* p) { return hn::LoadU(d, p); };
  int found = 0;
  for (int x = 0; x < count; x += lanes) {
    const auto score = load(row + x);
    if (hn::AllTrue(d, score == hn::Zero(d))) continue;
    auto highest = hn::Max(load(row + x - 1), load(row + x + 1));
    for (const std::uint8_t* other : {above + x, below + x}) {
      highest = hn::Max(highest, hn::Max(load(other), hn::Max(load(other - 1), load(other + 1))));
    }
    std::uint64_t bits = maskBits(score > highest);
    if (count - x < lanes) bits &= (std::uint64_t{1} << (count - x)) - 1;
    for (; bits != 0; bits &= bits - 1) {
      maxima[found++] = x + static_cast<int>(hwy::Num0BitsBelowLS1Bit_Nonzero64(bits));
    }
  }
  return found;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb
HWY_AFTER_NAMESPACE();
