// The inner loop of LocalMatcher in plain C++, the reference for the vector versions.
#include "core/growth/alike_kernel.h"

#include <cmath>

namespace ktgp_orb::growth {
namespace {

std::size_t findAlike(const float* columns, std::size_t pitch, std::uint32_t begin,
                      std::uint32_t end, const LocalFrame& predicted, float squared_radius,
                      std::uint32_t* alike, bool& is_near) {
  std::size_t count = 0;
  for (std::uint32_t i = begin; i < end; ++i) {
    const auto value = [&](std::size_t column) { return columns[column * pitch + i]; };
    const float x = value(0) - predicted.x;
    const float y = value(1) - predicted.y;
    if (!(x * x + y * y <= squared_radius)) continue;
    is_near = true;
    const float cosine = value(2) * predicted.dx + value(3) * predicted.dy;
    const float log_scale = std::abs(value(4) - predicted.log_size);
    if (cosine >= kAlikeCosine && log_scale <= kAlikeLogScale) alike[count++] = i;
  }
  return count;
}

}  // namespace

const AlikeKernel& portableAlikeKernel() {
  static constexpr AlikeKernel kPortable{"portable", findAlike};
  return kPortable;
}

}  // namespace ktgp_orb::growth
