// Vectorised TEBLID for keypoints that are so far from the border that all boxes are inside the
// image (see isFarFromBorder). No include guard: dispatch.cpp includes this once for each
// instruction set.
#include <hwy/highway.h>

#include "features/orb/teblid_kernel.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::orb {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// The order of the operations and their roundings is part of the descriptor's definition; see
// placed() in teblid.cpp.
HWY_INLINE void placeCentres(const TeblidPlacement& placement, std::int32_t stride,
                             std::int32_t* HWY_RESTRICT centres) {
  const hn::ScalableTag<float> d;
  const hn::RebindToSigned<decltype(d)> di;
  const auto set = [d](float value) { return hn::Set(d, value); };
  for (int i = 0; i < 2 * kTeblidBits; i += static_cast<int>(hn::Lanes(d))) {
    const auto u = hn::Load(d, kTeblidOrder.u + i);
    const auto v = hn::Load(d, kTeblidOrder.v + i);
    const auto to_pixel = [&](float from_u, float from_v, float origin) {
      const auto turned = hn::Add(hn::Mul(set(from_u), u), hn::Mul(set(from_v), v));
      return hn::ConvertTo(di, hn::Add(hn::Add(turned, set(origin)), set(0.5f)));
    };
    const auto x = to_pixel(placement.x_from_u, placement.x_from_v, placement.x);
    const auto y = to_pixel(placement.y_from_u, placement.y_from_v, placement.y);
    hn::Store(hn::Add(hn::Mul(y, hn::Set(di, stride)), x), di, centres + i);
  }
}

HWY_INLINE void packBits(const std::int32_t* differences, const std::int32_t* bound,
                         std::uint8_t* descriptor) {
  const hn::CappedTag<std::int32_t, 8> d;
  for (int byte = 0; byte < kTeblidBits / 8; ++byte) {
    unsigned bits = 0;
    for (int i = 0; i < 8; i += static_cast<int>(hn::Lanes(d))) {
      const auto below = hn::Lt(hn::Load(d, differences + 8 * byte + i),  //
                                hn::LoadU(d, bound + 8 * byte + i));
      std::uint8_t mask[8] = {};
      hn::StoreMaskBits(d, below, mask);
      bits |= static_cast<unsigned>(mask[0]) << i;
    }
    descriptor[byte] = static_cast<std::uint8_t>(bits);
  }
}

void describeTeblidInside(const std::uint32_t* integral, const TeblidScale& scale,
                          const TeblidPlacement& placement, std::uint8_t* descriptor) {
  HWY_ALIGN std::int32_t centres[2 * kTeblidBits];
  HWY_ALIGN std::int32_t differences[kTeblidBits];
  placeCentres(placement, scale.stride, centres);
  compareBoxes(integral, scale, centres, differences);
  packBits(differences, scale.bound, descriptor);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::orb
HWY_AFTER_NAMESPACE();
