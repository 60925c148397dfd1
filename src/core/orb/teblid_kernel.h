#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>

#include "core/orb/teblid_geometry.h"
#include "core/orb/teblid_table.h"

namespace ktgp_orb::orb {

/// The radii of the table's boxes are 1 to this value, in px of the patch.
constexpr int kTeblidRadii = 7;

/// TEBLID's bits ordered by the radius of their boxes, so that many consecutive boxes have the same
/// distances from the centre to the corners.
struct TeblidOrder {
  /// Box centres in px of the patch: the first of every pair, then the second ones.
  alignas(64) float u[2 * kTeblidBits];
  alignas(64) float v[2 * kTeblidBits];
  /// Position in the descriptor: byte, and bit counted from the lowest.
  std::uint8_t place[kTeblidBits];
  /// Index after the last pair of radius r.
  std::int16_t end[kTeblidRadii + 1];
};

constexpr int teblidPlace(int bit) {
  return bit / 8 * 8 + 7 - bit % 8;
}

constexpr TeblidOrder makeTeblidOrder() {
  TeblidOrder order{};
  std::int16_t next = 0;
  for (int radius = 1; radius <= kTeblidRadii; ++radius) {
    for (int bit = 0; bit < kTeblidBits; ++bit) {
      if (kTeblidTable.radius[bit] != radius) continue;
      order.u[next] = kTeblidTable.first_x[bit];
      order.v[next] = kTeblidTable.first_y[bit];
      order.u[kTeblidBits + next] = kTeblidTable.second_x[bit];
      order.v[kTeblidBits + next] = kTeblidTable.second_y[bit];
      order.place[next++] = static_cast<std::uint8_t>(teblidPlace(bit));
    }
    order.end[radius] = next;
  }
  return order;
}

constexpr TeblidOrder kTeblidOrder = makeTeblidOrder();
static_assert(kTeblidOrder.end[kTeblidRadii] == kTeblidBits, "a radius beyond kTeblidRadii");

/// The values that the boxes of all keypoints of one size share.
struct TeblidScale {
  /// `keypoint_size` in px; `stride`: values in a row of the integral image.
  TeblidScale(float keypoint_size, int stride);

  /// Offsets of the sums at the corners of a box from the sum at its centre pixel.
  struct Corners {
    std::ptrdiff_t top_left, top_right, bottom_left, bottom_right;
  };

  float keypoint_size;
  int stride;
  Corners corners[kTeblidRadii + 1];  ///< by radius in the table
  /// A bit is set where the difference of the two sums is less than this; by position in the
  /// descriptor.
  std::int32_t bound[kTeblidBits];
};

struct TeblidKernel {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// The descriptor of a keypoint far from the border (see isFarFromBorder); `integral` points to
  /// the first value of the integral image.
  void (*describe)(const std::uint32_t* integral, const TeblidScale& scale,
                   const TeblidPlacement& placement, std::uint8_t* descriptor);
};

/// Plain C++, the reference for the other sets.
const TeblidKernel& portableTeblidKernel();
/// The fastest set that this machine supports.
const TeblidKernel& bestTeblidKernel();

/// Differences of the sums of each pair of boxes, by position in the descriptor. `centres`: of the
/// boxes in kTeblidOrder, as indices of the integral image.
inline void compareBoxes(const std::uint32_t* integral, const TeblidScale& scale,
                         const std::int32_t* centres, std::int32_t* differences) {
  int i = 0;
  for (int radius = 1; radius <= kTeblidRadii; ++radius) {
    // One pointer per corner, so that a read is a single instruction: base plus centre.
    const TeblidScale::Corners at = scale.corners[radius];
    const std::uint32_t* const top_left = integral + at.top_left;
    const std::uint32_t* const top_right = integral + at.top_right;
    const std::uint32_t* const bottom_left = integral + at.bottom_left;
    const std::uint32_t* const bottom_right = integral + at.bottom_right;
    const auto sum = [&](std::ptrdiff_t centre) {
      return top_left[centre] - top_right[centre] - bottom_left[centre] + bottom_right[centre];
    };
    // Reads the sums one by one: gather instructions are not faster, and on many processors much
    // slower. The differences are right even if large images overflow the sums.
    for (; i < kTeblidOrder.end[radius]; ++i) {
      differences[kTeblidOrder.place[i]] =
          static_cast<std::int32_t>(sum(centres[i]) - sum(centres[kTeblidBits + i]));
    }
  }
}

}  // namespace ktgp_orb::orb
