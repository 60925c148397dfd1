// The inner loop of LocalMatcher. It has no include guard, because dispatch.cpp includes it once
// for each instruction set.
#include <hwy/highway.h>

#include "growth/alike_kernel.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::growth {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// See AlikeKernel::find. The range [begin, end) has only a few keypoints, so lanes past `end` are
// masked out.
std::size_t findAlike(const float* columns, std::size_t pitch, std::uint32_t begin,
                      std::uint32_t end, const LocalFrame& predicted, float squared_radius,
                      std::uint32_t* alike, bool& is_near) {
  const hn::CappedTag<float, kReadBeyond> d;
  std::size_t count = 0;
  for (std::uint32_t i = begin; i < end; i += static_cast<std::uint32_t>(hn::Lanes(d))) {
    const auto values = [&](std::size_t column) {
      return hn::LoadU(d, columns + column * pitch + i);
    };
    const auto x = hn::Sub(values(0), hn::Set(d, predicted.x));
    const auto y = hn::Sub(values(1), hn::Set(d, predicted.y));
    const auto squared = hn::Add(hn::Mul(x, x), hn::Mul(y, y));
    const auto is_inside =
        hn::And(hn::FirstN(d, end - i), hn::Le(squared, hn::Set(d, squared_radius)));
    if (hn::AllFalse(d, is_inside)) continue;
    is_near = true;
    const auto cosine = hn::Add(hn::Mul(values(2), hn::Set(d, predicted.dx)),
                                hn::Mul(values(3), hn::Set(d, predicted.dy)));
    const auto log_scale = hn::Abs(hn::Sub(values(4), hn::Set(d, predicted.log_size)));
    const auto is_alike = hn::And(hn::Ge(cosine, hn::Set(d, kAlikeCosine)),
                                  hn::Le(log_scale, hn::Set(d, kAlikeLogScale)));
    std::uint8_t bits[8] = {};
    hn::StoreMaskBits(d, hn::And(is_inside, is_alike), bits);
    for (std::uint32_t left = bits[0]; left != 0; left &= left - 1) {
      alike[count++] = i + static_cast<std::uint32_t>(hwy::Num0BitsBelowLS1Bit_Nonzero32(left));
    }
  }
  return count;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::growth
HWY_AFTER_NAMESPACE();
