#pragma once

#include <cstddef>
#include <cstdint>

namespace ktgp_orb::alignment {

/// Side of the aligned patch, px. Sixteen floats fill whole vectors of every width.
constexpr int kPatchSide = 16;
/// Number of px that smoothing and derivatives read beyond the patch on each side.
constexpr int kPatchBorder = 2;
/// Side of the warped reference patch before smoothing, px.
constexpr int kWarpSide = kPatchSide + 2 * kPatchBorder;
/// Length of a row of the reference patch in memory, in floats: a multiple of the vector length.
constexpr std::ptrdiff_t kWarpPitch = 24;
/// Side of the target's window in which the patch is moved, px: after smoothing (kWindowSide) and
/// before smoothing (kRawWindowSide).
constexpr int kWindowSide = 28;
constexpr int kRawWindowSide = kWindowSide + 2 * kPatchBorder;
constexpr std::ptrdiff_t kWindowPitch = 32;

/// The slanted grid on which a patch is sampled: the position of sample (0, 0), relative to a given
/// pixel, and the steps to the next column and to the next row, all in units of 1/65536 px.
struct AffineWalk {
  std::int32_t x0, y0;              ///< position of sample (0, 0)
  std::int32_t x_column, y_column;  ///< step to the next column
  std::int32_t x_row, y_row;        ///< step to the next row
};

/// A smoothed patch of the reference and its derivatives with respect to x and y, each with its
/// mean subtracted.
struct alignas(64) PatchTemplate {
  float value[kPatchSide][kPatchSide];
  float dx[kPatchSide][kPatchSide];
  float dy[kPatchSide][kPatchSide];
  /// Sums of products over the patch, for example tx = sum of t * x. t: value; x, y: derivatives
  /// with respect to x and y.
  float tt, tx, ty, xx, xy, yy;
};

/// Sums over a patch: the target's values i, their squares, and their products with the template's
/// value t and its derivatives x and y.
struct MatchSums {
  float i, ii, ti, xi, yi;
};

/// The pixel loops of the alignment, one set of functions per instruction set. All sets give
/// bit-identical results: each of sixteen columns has its own sum, the sums are added in a fixed
/// order at the end, and multiply-adds are not fused.
struct AlignmentKernels {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// Samples an image bilinearly along `walk`, starting at `pixel`, and writes kWarpSide rows of
  /// kWarpPitch values. All sampled pixels, and two bytes to their right, must be readable.
  void (*warp)(const std::uint8_t* pixel, std::ptrdiff_t stride, const AffineWalk& walk,
               float* patch);

  /// Smooths the patch (binomial filter with five taps, sigma 1), computes its derivatives, and
  /// sums up their products.
  void (*prepare)(const float* patch, PatchTemplate& out);

  /// Smooths kRawWindowSide rows and columns, starting at `pixel`, into kWindowSide rows of
  /// kWindowPitch values. Four more columns on the right must be readable.
  void (*smooth)(const std::uint8_t* pixel, std::ptrdiff_t stride, float* window);

  /// Compares the template with the patch of the window that begins (fx, fy) px to the right of and
  /// below `corner`, 0 <= fx, fy < 1; interpolates its values. Reads one row and column before the
  /// patch, and two after it.
  MatchSums (*compare)(const float* corner, float fx, float fy, const PatchTemplate& patch);
};

/// Weights for interpolation at the fraction `f` of a pixel: the weight of the pixel itself (`at`),
/// of the pixel before, and of the two pixels after. This cubic displaces a pattern of waves with a
/// wavelength of six pixels or more by less than 0.001 px. The cubic of Catmull and Rom would
/// displace it by up to 0.017 px, always towards whole pixels, so that the errors would add up from
/// frame to frame if the camera moves slowly.
struct CubicWeights {
  float before, at, behind, last;
  explicit CubicWeights(float f)
      : before(((0.4F - 0.1F * f) * f - 0.3F) * f),
        at(((0.3F * f - 0.7F) * f - 0.6F) * f + 1.F),
        behind(((0.2F - 0.3F * f) * f + 1.1F) * f),
        last(((0.1F * f + 0.1F) * f - 0.2F) * f) {}
};

/// The total of sixteen column sums, added in the order that all kernels use.
inline float sumOfColumns(const float* s) {
  float quarter[4];
  for (int i = 0; i < 4; ++i) quarter[i] = (s[i] + s[i + 8]) + (s[i + 4] + s[i + 12]);
  return (quarter[0] + quarter[2]) + (quarter[1] + quarter[3]);
}

/// Returns the functions in plain C++, which are the reference for the other sets.
const AlignmentKernels& portableAlignmentKernels();
/// Returns the fastest set that this build and this processor support.
const AlignmentKernels& bestAlignmentKernels();

}  // namespace ktgp_orb::alignment
