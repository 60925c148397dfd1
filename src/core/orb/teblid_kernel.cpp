// TEBLID far from the border. The vector code is compiled for every instruction set and chosen at
// run time; without Highway the loops are plain.
#include "core/orb/teblid_kernel.h"

#ifdef KTGP_ORB_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/orb/teblid_kernel.cpp"
#include <hwy/foreach_target.h>  // includes this file again for each instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Each operation rounds, in the order of the definition (see placed() in teblid.cpp).
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

void describeInside(const std::uint32_t* integral, const TeblidScale& scale,
                    const TeblidPlacement& placement, std::uint8_t* descriptor) {
  HWY_ALIGN std::int32_t centres[2 * kTeblidBits];
  HWY_ALIGN std::int32_t differences[kTeblidBits];
  placeCentres(placement, scale.stride, centres);
  compareBoxes(integral, scale, centres, differences);
  packBits(differences, scale.bound, descriptor);
}

}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb
HWY_AFTER_NAMESPACE();
#endif  // KTGP_ORB_HAVE_HIGHWAY

#if !defined(KTGP_ORB_HAVE_HIGHWAY) || HWY_ONCE
#include <cmath>

namespace ktgp_orb {

#ifdef KTGP_ORB_HAVE_HIGHWAY
HWY_EXPORT(describeInside);

void describeTeblidInside(const std::uint32_t* integral, const TeblidScale& scale,
                          const TeblidPlacement& placement, std::uint8_t* descriptor) {
  HWY_DYNAMIC_DISPATCH(describeInside)(integral, scale, placement, descriptor);
}
#else
void describeTeblidInside(const std::uint32_t* integral, const TeblidScale& scale,
                          const TeblidPlacement& p, std::uint8_t* descriptor) {
  std::int32_t centres[2 * kTeblidBits];
  std::int32_t differences[kTeblidBits];
  for (int i = 0; i < 2 * kTeblidBits; ++i) {
    const float u = kTeblidOrder.u[i];
    const float v = kTeblidOrder.v[i];
    const int x = static_cast<int>(p.x_from_u * u + p.x_from_v * v + p.x + 0.5f);
    const int y = static_cast<int>(p.y_from_u * u + p.y_from_v * v + p.y + 0.5f);
    centres[i] = y * scale.stride + x;
  }
  compareBoxes(integral, scale, centres, differences);
  for (int byte = 0; byte < kTeblidBits / 8; ++byte) {
    unsigned bits = 0;
    for (int i = 8 * byte + 7; i >= 8 * byte; --i) {
      bits = 2 * bits + static_cast<unsigned>(differences[i] < scale.bound[i]);
    }
    descriptor[byte] = static_cast<std::uint8_t>(bits);
  }
}
#endif

TeblidScale::TeblidScale(float size, int row) : keypoint_size(size), stride(row), corners{} {
  int area[kTeblidRadii + 1] = {};
  for (int radius = 1; radius <= kTeblidRadii; ++radius) {
    const int r = static_cast<int>(size / kTeblidPatch * static_cast<float>(radius) + 0.5f);
    const std::ptrdiff_t above = static_cast<std::ptrdiff_t>(-r) * stride;
    const std::ptrdiff_t below = static_cast<std::ptrdiff_t>(r + 1) * stride;
    corners[radius] = {above - r, above + r + 1, below - r, below + r + 1};
    area[radius] = (2 * r + 1) * (2 * r + 1);
  }
  for (int bit = 0; bit < kTeblidBits; ++bit) {
    const auto pixels = static_cast<float>(area[kTeblidTable.radius[bit]]);
    bound[teblidPlace(bit)] =
        static_cast<std::int32_t>(std::floor(kTeblidTable.threshold[bit] * pixels)) + 1;
  }
}

}  // namespace ktgp_orb
#endif
