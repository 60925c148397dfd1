// The inner loop of LocalMatcher in plain C++, the reference for the vector versions.
#include "core/growth/alike_kernel.h"

#include <cmath>

namespace ktgp_orb::growth {
namespace {

std::size_t findAlike(const KeypointColumns& keypoints, std::uint32_t begin, std::uint32_t end,
                      const AlikeQuery& query, std::uint32_t* alike, bool& is_near) {
  std::size_t count = 0;
  for (std::uint32_t i = begin; i < end; ++i) {
    const float x = keypoints.x[i] - query.x;
    const float y = keypoints.y[i] - query.y;
    if (!(x * x + y * y <= query.squared_radius)) continue;
    is_near = true;
    const float cosine = keypoints.dx[i] * query.dx + keypoints.dy[i] * query.dy;
    const float log_scale = std::abs(keypoints.log_size[i] - query.log_size);
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
