#pragma once

#include <cstddef>
#include <cstdint>

namespace ktgp_orb::orb {

/// Radius of the disc whose intensity centroid gives a keypoint its angle, in px.
constexpr int kOrientationRadius = 15;
/// Side of a keypoint's patch on its pyramid level, in px: the size of keypoints on the lowest.
constexpr int kPatchSize = 2 * kOrientationRadius + 1;
/// Radius of the blur before the descriptor, in px.
constexpr int kBlurRadius = 3;
/// Largest offset, along x or y, of a pixel that the rotated sampling pattern reads, in px.
constexpr int kPatternRadius = 18;
/// Keypoints stay this far from the border of their pyramid level, in px.
constexpr int kEdgeMargin = kPatchSize;

/// First-order moments of the intensities around a keypoint (Rosin, 1999): sums of x*I and y*I.
struct Moments {
  int x = 0;
  int y = 0;
};

/// Target pixels that are interpolated at a time.
constexpr int kResizeBlock = 8;

/// Where kResizeBlock neighbouring pixels of a resized row come from: for each its left and then,
/// in the second half, its right source pixel, with weights that add up to 256.
struct ResizeBlock {
  std::int32_t start;                   ///< first source pixel of the block
  std::uint8_t taps[2 * kResizeBlock];  ///< source pixels, from `start` on
  std::uint16_t weights[2 * kResizeBlock];
};

/// The pixel loops of ORB. One set of functions per instruction set; all give the same bits.
///
/// A `pixel` pointer stands on the pixel meant; `stride` is the distance of rows in bytes.
struct OrbKernels {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// Linear interpolation along a row into `count` blocks of values in units of 1/256. The taps are
  /// 0..15 (plain C++: any) and 16 bytes from each start are readable.
  void (*resize_row)(const std::uint8_t* row, const ResizeBlock* blocks, int count,
                     std::uint16_t* out);
  /// Interpolation between two such rows, with `weight`/256 for the one below, to the nearest
  /// integer, half up. May read 64 values beyond and write 64 bytes beyond out[count - 1].
  void (*mix_rows)(const std::uint16_t* above, const std::uint16_t* below, int weight, int count,
                   std::uint8_t* out);

  /// FAST-9 scores (Rosten & Drummond, ECCV 2006) of `count` pixels of a row: the largest threshold
  /// at which a pixel is still a corner, or 0 where that is below `threshold` (1..255).
  /// Reads three pixels around; may read 64 bytes beyond and write 64 beyond scores[count - 1].
  void (*fast_scores)(const std::uint8_t* pixel, std::ptrdiff_t stride, int count, int threshold,
                      std::uint8_t* scores);

  /// Non-maximum suppression: writes the indices of the scores in `row` that exceed all eight
  /// neighbours to `maxima`, ascending, and returns their number. The rows hold `count` scores and
  /// are readable one before and 64 beyond; `maxima` has room for `count` + 3.
  int (*local_maxima)(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below,
                      int count, std::int32_t* maxima);

  /// Harris response (k = 0.04) of the 7x7 block of Sobel gradients around a pixel.
  float (*harris)(const std::uint8_t* pixel, std::ptrdiff_t stride);

  /// Moments of the disc of kOrientationRadius.
  Moments (*moments)(const std::uint8_t* pixel, std::ptrdiff_t stride);

  /// Gaussian blur along a row: `count` pixels from `pixel` on, which has kBlurRadius neighbours
  /// on either side. May read 80 bytes beyond and write 64 values beyond out[count - 1]; every 64
  /// values are in an order of the set's own, which its blur_across_rows undoes.
  void (*blur_along_row)(const std::uint8_t* pixel, int count, float* out);
  /// Gaussian blur across 2 * kBlurRadius + 1 such rows, from the top down, to the nearest integer.
  /// May read 64 values beyond and write 64 bytes beyond out[count - 1].
  void (*blur_across_rows)(const float* const* rows, int count, std::uint8_t* out);

  /// rBRIEF (Rublee et al., section 4) around a pixel of the blurred image, its sampling pattern
  /// rotated by the angle of this cosine and sine: 32 bytes.
  using Describe = void (*)(const std::uint8_t* pixel, std::ptrdiff_t stride, float cosine,
                            float sine, std::uint8_t* descriptor);
  Describe describe;
  /// The same with instructions that gather several pixels, where there are any; may read three
  /// bytes beyond each pixel. Faster on some processors, slower on others: see fasterDescribe.
  Describe describe_by_gathers;
};

/// Plain C++, the definition of what the others compute.
const OrbKernels& portableOrbKernels();
/// The fastest set that this build has and this processor runs.
const OrbKernels& bestOrbKernels();

}  // namespace ktgp_orb::orb
