#pragma once

#include <cstddef>
#include <cstdint>

namespace ktgp_orb::growth {

/// Entries past the last keypoint that the kernels may read.
constexpr std::size_t kReadBeyond = 8;

/// A keypoint as a position, a direction of length 1 and a size. It is defined here, since the
/// kernels are compiled without Eigen.
struct LocalFrame {
  float x, y;      ///< px
  float dx, dy;    ///< direction
  float log_size;  ///< natural logarithm of the diameter in px
};
constexpr std::size_t kLocalFrameValues = 5;

constexpr float kAlikeCosine = 0.825336F;    ///< cosine of the largest rotation, 0.6 rad
constexpr float kAlikeLogScale = 0.587787F;  ///< logarithm of the largest ratio of sizes, 1.8

/// The inner loop of LocalMatcher::match(), one per instruction set; all give the same numbers.
struct AlikeKernel {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// The keypoints `begin` to `end` (excluded) within the radius (px, squared) of the predicted
  /// one, with similar direction and size: writes their numbers to `alike`, ascending, and returns
  /// how many. `is_near` becomes true if any of them is within the radius. `columns`: the first
  /// value of LocalFrame of all keypoints, `pitch` floats later the second one of all, and so on.
  /// `alike`: room for all of them.
  std::size_t (*find)(const float* columns, std::size_t pitch, std::uint32_t begin,
                      std::uint32_t end, const LocalFrame& predicted, float squared_radius,
                      std::uint32_t* alike, bool& is_near);
};

/// Plain C++, the reference for the others.
const AlikeKernel& portableAlikeKernel();
/// The fastest one that this build and this processor support.
const AlikeKernel& bestAlikeKernel();

}  // namespace ktgp_orb::growth
