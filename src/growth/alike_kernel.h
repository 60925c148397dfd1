#pragma once

#include <cstddef>
#include <cstdint>

namespace ktgp_orb::growth {

/// The kernels may read up to this many entries past the last keypoint of a column.
constexpr std::size_t kReadBeyond = 8;

/// Position, direction (a vector of length 1) and size of a keypoint. The struct is defined here
/// because the kernels are compiled without Eigen.
struct LocalFrame {
  float x, y;      ///< px
  float dx, dy;    ///< direction
  float log_size;  ///< natural logarithm of the diameter in px
};
constexpr std::size_t kLocalFrameValues = 5;

/// Cosine of 0.6 rad, the largest difference between two similar directions.
constexpr float kAlikeCosine = 0.825336F;
constexpr float kAlikeLogScale = 0.587787F;  ///< log of 1.8, the largest ratio of similar sizes

/// The inner loop of LocalMatcher::match(). Each instruction set has its own kernel, and all
/// kernels give equal results.
struct AlikeKernel {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// Finds the keypoints in [begin, end) that are within the radius (px, squared) of `predicted`
  /// and similar to it in direction and size. Writes their indices to `alike` in ascending order,
  /// and returns their number. `is_near` becomes true if any keypoint is within the radius, even
  /// with another direction or size. `columns`: the members of LocalFrame as columns: x of all
  /// keypoints, then y of all keypoints, and so on. A column begins `pitch` floats after the
  /// previous column. `alike`: an array with room for an entry for each keypoint.
  std::size_t (*find)(const float* columns, std::size_t pitch, std::uint32_t begin,
                      std::uint32_t end, const LocalFrame& predicted, float squared_radius,
                      std::uint32_t* alike, bool& is_near);
};

/// The kernel in plain C++. The results of the other kernels must equal its results.
const AlikeKernel& portableAlikeKernel();
/// The fastest kernel that this build and this processor support.
const AlikeKernel& bestAlikeKernel();

}  // namespace ktgp_orb::growth
