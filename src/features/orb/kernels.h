#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

namespace ktgp_orb::orb {

struct TeblidPlacement;
struct TeblidScale;

/// Number of bytes after the end of a row that the kernels may read and write.
constexpr int kVectorSlack = 64;

/// Radius of the disc whose intensity centroid gives a keypoint its angle, in px.
constexpr int kOrientationRadius = 15;
/// Side of a keypoint's patch on its pyramid level, in px. It is also the size (cv::KeyPoint::size)
/// of keypoints of level 0.
constexpr int kPatchSize = 2 * kOrientationRadius + 1;
/// Radius of the blur before the descriptor, in px.
constexpr int kBlurRadius = 3;
/// Largest offset, in x or y, of a pixel in the rotated sampling pattern, in px.
constexpr int kPatternRadius = 18;
/// Minimum distance of keypoints from the border of their pyramid level, in px.
constexpr int kEdgeMargin = kPatchSize;

/// Number of target pixels that are interpolated at once.
constexpr int kResizeBlock = 8;

/// Source pixels of kResizeBlock neighbouring target pixels: first the left source pixels of all
/// target pixels, then the right source pixels. The two weights of a target pixel add up to 256.
struct ResizeBlock {
  std::int32_t start;                   ///< first source pixel of the block
  std::uint8_t taps[2 * kResizeBlock];  ///< positions of the source pixels, counted from `start`
  std::uint16_t weights[2 * kResizeBlock];
};

/// The pixel loops of ORB, one set of functions per instruction set. All sets give bit-identical
/// results.
///
/// A `pixel` pointer points to the centre pixel; `stride` is the distance between two rows in
/// bytes.
struct OrbKernels {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// Interpolates linearly along a row and writes `count` blocks of values, in units of 1/256. The
  /// taps must be 0..15 (in plain C++ they may be larger), and 16 bytes of the row must be readable
  /// from the start of each block on.
  void (*resize_row)(const std::uint8_t* row, const ResizeBlock* blocks, int count,
                     std::uint16_t* out);
  /// Interpolates between two rows written by resize_row, with the weight `weight`/256 for the row
  /// below, and rounds to the nearest integer, half up. May read 64 values beyond the end of a row
  /// and write 64 bytes beyond out[count - 1].
  void (*mix_rows)(const std::uint16_t* above, const std::uint16_t* below, int weight, int count,
                   std::uint8_t* out);

  /// FAST-9 scores (Rosten & Drummond, ECCV 2006) of `count` pixels of a row: the largest threshold
  /// at which a pixel is still a corner, or 0 if this value is below `threshold` (1..255). Reads
  /// the pixels within a radius of three; may read 64 bytes after the end of the row and write 64
  /// bytes after scores[count - 1].
  void (*fast_scores)(const std::uint8_t* pixel, std::ptrdiff_t stride, int count, int threshold,
                      std::uint8_t* scores);

  /// Non-maximum suppression: writes the indices of the scores in `row` that exceed all eight
  /// neighbours to `maxima`, ascending, and returns their number. The rows have `count` scores; one
  /// score before them and 64 scores after them must be readable. `maxima` has room for `count` + 3
  /// indices.
  int (*local_maxima)(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below,
                      int count, std::int32_t* maxima);

  /// Harris response (k = 0.04) of the 7x7 block of Sobel gradients around a pixel.
  float (*harris)(const std::uint8_t* pixel, std::ptrdiff_t stride);

  /// First-order moments of the intensities around a keypoint (Rosin, 1999): sums of x*I and y*I in
  /// the disc of kOrientationRadius.
  std::pair<int, int> (*moments)(const std::uint8_t* pixel, std::ptrdiff_t stride);

  /// Gaussian blur along a row of `count` pixels from `pixel` on, with kBlurRadius neighbours on
  /// each side. May read 80 bytes beyond the end of the row and write 64 values beyond out[count -
  /// 1]. The order of the values within each group of 64 depends on the set of functions;
  /// blur_across_rows of the same set restores the order.
  void (*blur_along_row)(const std::uint8_t* pixel, int count, float* out);
  /// Gaussian blur across 2 * kBlurRadius + 1 rows written by blur_along_row, top row first; rounds
  /// to the nearest integer. May read 64 values beyond the end of a row and write 64 bytes beyond
  /// out[count - 1].
  void (*blur_across_rows)(const float* const* rows, int count, std::uint8_t* out);

  /// rBRIEF (Rublee et al., section 4) around a pixel of the blurred image, with the sampling
  /// pattern rotated by the angle with this cosine and sine. Writes 32 bytes. May read three bytes
  /// beyond each pixel.
  void (*describe)(const std::uint8_t* pixel, std::ptrdiff_t stride, float cosine, float sine,
                   std::uint8_t* descriptor);

  /// The TEBLID descriptor of a keypoint far from the border (see isFarFromBorder); `integral`
  /// points to the first value of the integral image.
  void (*describe_teblid)(const std::uint32_t* integral, const TeblidScale& scale,
                          const TeblidPlacement& placement, std::uint8_t* descriptor);
};

/// Returns the functions in plain C++, which are the reference for the other sets.
const OrbKernels& portableOrbKernels();
/// Returns the fastest set that this build and this processor support.
const OrbKernels& bestOrbKernels();

}  // namespace ktgp_orb::orb
