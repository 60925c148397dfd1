// TEBLID far from the border in plain C++.
#include "core/orb/teblid_kernel.h"

#include <algorithm>
#include <cmath>

namespace ktgp_orb::orb {
namespace {

constexpr float kHalf = 0.5f;  // the authors' program truncates v + 0.5

void describeInside(const std::uint32_t* integral, const TeblidScale& scale,
                    const TeblidPlacement& p, std::uint8_t* descriptor) {
  std::int32_t centres[2 * kTeblidBits];
  std::int32_t differences[kTeblidBits];
  for (int i = 0; i < 2 * kTeblidBits; ++i) {
    const float u = kTeblidOrder.u[i];
    const float v = kTeblidOrder.v[i];
    const int x = static_cast<int>(p.x_from_u * u + p.x_from_v * v + p.x + kHalf);
    const int y = static_cast<int>(p.y_from_u * u + p.y_from_v * v + p.y + kHalf);
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

}  // namespace

TeblidScale::TeblidScale(float size, int row) : keypoint_size(size), stride(row), corners{} {
  float area[kTeblidRadii + 1] = {};
  for (int radius = 1; radius <= kTeblidRadii; ++radius) {
    const int r = static_cast<int>(size / kTeblidPatch * static_cast<float>(radius) + kHalf);
    const std::ptrdiff_t above = static_cast<std::ptrdiff_t>(-r) * stride;
    const std::ptrdiff_t below = static_cast<std::ptrdiff_t>(r + 1) * stride;
    corners[radius] = {above - r, above + r + 1, below - r, below + r + 1};
    const auto side = static_cast<float>(2 * r + 1);
    area[radius] = side * side;
  }
  for (int bit = 0; bit < kTeblidBits; ++bit) {
    // If the image is too small for keypoints on the highest levels, their boxes exceed any image.
    constexpr float kMost = 1 << 30;
    const float difference =
        std::floor(kTeblidTable.threshold[bit] * area[kTeblidTable.radius[bit]]);
    bound[teblidPlace(bit)] = static_cast<std::int32_t>(std::clamp(difference, -kMost, kMost)) + 1;
  }
}

const TeblidKernel& portableTeblidKernel() {
  static constexpr TeblidKernel kPortable{"portable", describeInside};
  return kPortable;
}

}  // namespace ktgp_orb::orb
