#pragma once

#include <cstddef>
#include <cstdint>

namespace ktgp_orb::growth {

/// Entries past the last keypoint that the kernels may read.
constexpr std::size_t kReadBeyond = 8;

/// Each property of the keypoints of an image in an array of its own; see LocalFrame.
struct KeypointColumns {
  const float* x;
  const float* y;
  const float* dx;
  const float* dy;
  const float* log_size;
};

/// The keypoint that is predicted; see LocalFrame.
struct AlikeQuery {
  float x, y;
  float dx, dy;
  float log_size;
  float squared_radius;  ///< px²
};

constexpr float kAlikeCosine = 0.825336F;    ///< of the largest rotation, 0.6 rad
constexpr float kAlikeLogScale = 0.587787F;  ///< of the largest ratio of sizes, 1.8

/// The inner loop of LocalMatcher::match(), one per instruction set; all give the same numbers.
struct AlikeKernel {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// The keypoints `begin` to `end` (excluded) within the radius, with similar direction and size:
  /// writes their numbers to `alike`, ascending, and returns how many. `is_near` becomes true if
  /// any of them is within the radius. `alike`: room for all of them.
  std::size_t (*find)(const KeypointColumns& keypoints, std::uint32_t begin, std::uint32_t end,
                      const AlikeQuery& query, std::uint32_t* alike, bool& is_near);
};

/// Plain C++, the reference for the others.
const AlikeKernel& portableAlikeKernel();
/// The fastest one that this build and this processor support.
const AlikeKernel& bestAlikeKernel();

}  // namespace ktgp_orb::growth
