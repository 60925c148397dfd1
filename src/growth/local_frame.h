#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <opencv2/core/types.hpp>

#include "growth/alike_kernel.h"
#include "ktgp_orb/features.h"
#include "util/constants.h"

namespace ktgp_orb::growth {

inline LocalFrame frameOf(const cv::KeyPoint& keypoint) {
  const float angle = keypoint.angle * static_cast<float>(util::kPi / 180.0);
  return {keypoint.pt.x, keypoint.pt.y, std::cos(angle), std::sin(angle),
          std::log(std::max(keypoint.size, 1e-3F))};
}

/// Maps the keypoint `frame` to another image. `to`: mapped position. `jacobian`: Jacobian of the
/// map at the keypoint; the map scales areas by exp(2 `log_scale`).
inline LocalFrame mapped(const LocalFrame& frame, const Eigen::Vector2f& to,
                         const Eigen::Matrix2f& jacobian, float log_scale) {
  const Eigen::Vector2f d = jacobian * Eigen::Vector2f(frame.dx, frame.dy);
  const float length = std::sqrt(d.squaredNorm());
  const float per_length = length > 0.F ? 1.F / length : 0.F;
  return {to.x(), to.y(), d.x() * per_length, d.y() * per_length, frame.log_size + log_scale};
}

/// A descriptor of 256 bits.
using Bits = std::array<std::uint64_t, 4>;

inline Bits bitsOf(const Features& features, std::size_t index) {
  Bits bits;
  std::memcpy(bits.data(), features.descriptors.ptr(static_cast<int>(index)), kDescriptorBytes);
  return bits;
}

/// Returns the number of bits that are set. Uses only instructions that every processor has.
inline int countBits(std::uint32_t v) {
  v -= (v >> 1) & 0x55555555U;
  v = (v & 0x33333333U) + ((v >> 2) & 0x33333333U);
  return static_cast<int>((((v + (v >> 4)) & 0x0f0f0f0fU) * 0x01010101U) >> 24);
}

/// Returns the Hamming distance. Uses only instructions that every processor has.
inline int distance(const Bits& a, const Bits& b) {
  std::uint64_t bytes = 0;  // each byte is the sum of four bit counts, at most 8 each
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::uint64_t v = a[i] ^ b[i];
    v -= (v >> 1) & 0x5555555555555555U;
    v = (v & 0x3333333333333333U) + ((v >> 2) & 0x3333333333333333U);
    bytes += (v + (v >> 4)) & 0x0f0f0f0f0f0f0f0fU;
  }
  bytes = (bytes & 0x00ff00ff00ff00ffU) + ((bytes >> 8) & 0x00ff00ff00ff00ffU);
  return static_cast<int>((bytes * 0x0001000100010001U) >> 48);
}

}  // namespace ktgp_orb::growth
