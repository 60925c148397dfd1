#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "features/orb/kernels.h"

namespace ktgp_orb::orb {

/// The pixels of FAST's circle of radius 3, clockwise, starting below the centre.
constexpr int kFastCircleX[16] = {0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1};
constexpr int kFastCircleY[16] = {3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1, 0, 1, 2, 3};

/// Half the side, in px, of the block over which the Harris response is summed.
constexpr int kHarrisRadius = 3;

/// Half the width of the orientation disc at 0..15 rows above or below its centre.
constexpr int kDiscHalfWidth[kOrientationRadius + 1] = {15, 15, 15, 15, 14, 14, 14, 13,
                                                        13, 12, 11, 10, 9,  8,  6,  3};
/// Number of columns of the disc, rounded up to whole registers.
constexpr int kDiscColumns = 32;

/// Mask of the disc for vector code: 255 inside the disc, else 0. The first index is the distance
/// of the row from the centre. Column c is at x = c - kOrientationRadius.
alignas(64) constexpr auto kDisc = [] {
  std::array<std::array<std::uint8_t, kDiscColumns>, kOrientationRadius + 1> disc{};
  for (std::size_t y = 0; y < disc.size(); ++y) {
    for (int x = -kDiscHalfWidth[y]; x <= kDiscHalfWidth[y]; ++x) {
      const int column = x + kOrientationRadius;
      disc[y][static_cast<std::size_t>(column)] = 255;
    }
  }
  return disc;
}();

/// The normalised Gaussian with a sigma of 2 px at the distances 0..3 px, in single precision.
constexpr float kGaussian[kBlurRadius + 1] = {0.216105938f, 0.190712824f, 0.131074876f,
                                              0.0701593235f};

/// If kRounder is added to a float of magnitude below 2^22, the float is rounded to the nearest
/// integer, half to even, and the low bits of the sum contain this integer. This takes one
/// instruction instead of a call of lrint.
constexpr float kRounder = 12582912.f;              // 1.5 * 2^23
constexpr std::uint32_t kRounderBits = 0x4B400000;  // kRounder as an integer with the same bits

/// Harris response det M - k (trace M)^2 of the structure tensor M. The gradients are scaled to
/// grey values in [0, 1], and divided by the sum of the Sobel weights and by the side of the block.
/// Every operation rounds to float, in this order, so that equal sums give equal responses on all
/// machines.
inline float harrisResponse(int xx, int yy, int xy) {
  constexpr float kK = 0.04f;
  constexpr float kScale = 1.f / (4 * (2 * kHarrisRadius + 1) * 255.f);
  constexpr float kScale4 = kScale * kScale * kScale * kScale;
  const auto a = static_cast<float>(xx);
  const auto b = static_cast<float>(yy);
  const auto c = static_cast<float>(xy);
  return (a * b - c * c - kK * (a + b) * (a + b)) * kScale4;
}

}  // namespace ktgp_orb::orb
