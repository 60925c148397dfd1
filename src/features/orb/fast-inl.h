// FAST-9 and non-maximum suppression for a whole register of pixels at once. No include guard:
// dispatch.cpp includes this once for each instruction set.
#include <hwy/highway.h>

#include <cstring>

#include "features/orb/kernels_common.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::orb {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Bytes = hn::ScalableTag<std::uint8_t>;
using ByteVector = hn::Vec<Bytes>;

// For each pixel, finds the darkest neighbour of every arc of nine neighbours on its circle, and
// returns the brightest of these 16 values. If it is brighter than the pixel, there is a bright
// arc.
//
// An arc that starts at an even neighbour and the arc that starts at the next neighbour share eight
// neighbours. Let `eight` be the minimum of these eight, and `first` and `last` the ninth
// neighbours of the two arcs. Then max(min(eight, first), min(eight, last)) =
// min(eight, max(first, last)).
HWY_INLINE ByteVector brightestArc(const ByteVector (&p)[16]) {
  ByteVector ends[8];
  ByteVector two[8];
  for (int i = 0; i < 8; ++i) {
    ends[i] = hn::Max(p[2 * i], p[(2 * i + 9) % 16]);
    two[i] = hn::Min(p[2 * i + 1], p[(2 * i + 2) % 16]);
  }
  ByteVector four[8];
  for (int i = 0; i < 8; ++i) four[i] = hn::Min(two[i], two[(i + 1) % 8]);
  ByteVector nine[8];
  for (int i = 0; i < 8; ++i) nine[i] = hn::Min(hn::Min(four[i], four[(i + 2) % 8]), ends[i]);
  for (int step = 4; step > 0; step /= 2) {
    for (int i = 0; i < step; ++i) nine[i] = hn::Max(nine[i], nine[i + step]);
  }
  return nine[0];
}

// A dark arc has nine neighbours that are darker than the pixel. Returns true for pixels that
// cannot have a dark arc. An arc of nine contains both neighbours of one opposite pair, so a dark
// arc needs a pair whose two neighbours are dark. (If there is such a pair, there can be no bright
// arc, because an arc also contains at least one neighbour of every opposite pair.)
HWY_INLINE hn::Mask<Bytes> canOnlyBeBright(const ByteVector (&p)[16], ByteVector centre) {
  ByteVector least = hn::Max(p[0], p[8]);
  for (int i = 1; i < 8; ++i) least = hn::Min(least, hn::Max(p[i], p[i + 8]));
  return least > centre;
}

// Any arc of nine contains two neighbouring compass points (the south, east, north and west pixels
// of the circle). So a pixel is no corner unless two neighbouring compass points have enough
// contrast to it.
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
  // One search finds both kinds of arcs: if all bits of a pixel and of its circle are inverted, a
  // dark arc becomes a bright arc.
  const auto inversion = hn::Not(hn::VecFromMask(d, canOnlyBeBright(p, centre)));
  for (ByteVector& neighbour : p) neighbour = hn::Xor(neighbour, inversion);
  const auto contrast = hn::SaturatedSub(brightestArc(p), hn::Xor(centre, inversion));
  return hn::IfThenElseZero(contrast > threshold, hn::SaturatedSub(contrast, hn::Set(d, 1)));
}

void fastScores(const std::uint8_t* pixel, std::ptrdiff_t stride, int count, int threshold,
                std::uint8_t* scores) {
  const Bytes d;
  const auto t = hn::Set(d, static_cast<std::uint8_t>(threshold));
  std::ptrdiff_t circle[16];
  for (int i = 0; i < 16; ++i) circle[i] = kFastCircleY[i] * stride + kFastCircleX[i];
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
    // Each round writes one maximum. There are always at least three rounds: a register seldom has
    // more than three maxima, and a branch that depends on their number would often be
    // mispredicted. A round without a maximum writes a meaningless index, but does not advance
    // `found`.
    for (int round = 0; round < 3 || bits != 0; ++round, bits &= bits - 1) {
      constexpr std::uint64_t kLast = std::uint64_t{1} << 63;
      maxima[found] = x + static_cast<int>(hwy::Num0BitsBelowLS1Bit_Nonzero64(bits | kLast));
      found += static_cast<int>(bits != 0);
    }
  }
  return found;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::orb
HWY_AFTER_NAMESPACE();
