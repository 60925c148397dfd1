#pragma once

#include <cstddef>
#include <cstdint>

namespace ktgp_orb::growth {

/// Number of entries past the last keypoint that the kernels may read.
constexpr std::size_t kReadBeyond = 8;

/// A keypoint as a position, a direction of length 1 and a size. It is defined here because the
/// kernels are compiled without Eigen.
struct LocalFrame {
  float x, y;      ///< px
  float dx, dy;    ///< direction
  float log_size;  ///< natural logarithm of the diameter in px
};
constexpr std::size_t kLocalFrameValues = 5;

constexpr float kAlikeCosine = 0.825336F;    ///< cosine of the largest rotation, 0.6 rad
constexpr float kAlikeLogScale = 0.587787F;  ///< logarithm of the largest ratio of sizes, 1.8

/// The inner loop of LocalMatcher::match(), one for each instruction set; all give equal results.
struct AlikeKernel {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// Finds the keypoints in [begin, end) within the radius (px, squared) of the prediction and with
  /// similar direction and size. Writes their numbers to `alike`, ascending, and returns how many.
  /// `is_near` becomes true if any keypoint is within the radius, even with another direction or
  /// size. `columns`: the first value of LocalFrame of all keypoints; the second value follows
  /// `pitch` floats later, and so on. `alike`: room for all keypoints.
  std::size_t (*find)(const float* columns, std::size_t pitch, std::uint32_t begin,
                      std::uint32_t end, const LocalFrame& predicted, float squared_radius,
                      std::uint32_t* alike, bool& is_near);
};

/// The loop in plain C++, the reference for the other kernels.
const AlikeKernel& portableAlikeKernel();
/// The fastest kernel that this build and this processor support.
const AlikeKernel& bestAlikeKernel();

}  // namespace ktgp_orb::growth
