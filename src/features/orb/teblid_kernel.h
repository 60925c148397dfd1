#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>

#include "features/orb/teblid_table.h"

namespace ktgp_orb::orb {

/// Largest radius of the table's boxes, in px of the patch; the smallest radius is 1.
constexpr int kTeblidRadii = 7;

/// This value is added to a coordinate before it is truncated to a pixel, so that halves are
/// rounded up, as in the authors' program.
constexpr float kTeblidHalf = 0.5f;

/// TEBLID's bits, ordered by the radius of their boxes, so that consecutive boxes mostly have the
/// same offsets from the centre to the corners.
struct TeblidOrder {
  /// Box centres in px of the patch: the first boxes of all pairs, followed by the second boxes.
  alignas(64) float u[2 * kTeblidBits];
  alignas(64) float v[2 * kTeblidBits];
  /// Position of each bit in the descriptor: 8 * byte + bit, counted from the lowest bit.
  std::uint8_t place[kTeblidBits];
  /// end[r]: index after the last pair of boxes with radius r.
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

/// Position of TEBLID's patch in the image: point (u, v) of the patch is at (x_from_u * u +
/// x_from_v * v + x, y_from_u * u + y_from_v * v + y), in px. The order of the operations, each
/// rounded to single precision, is part of the descriptor's definition.
struct TeblidPlacement {
  explicit TeblidPlacement(const cv::KeyPoint& keypoint) : scale(keypoint.size / kTeblidPatch) {
    const double radians = keypoint.angle >= 0 ? keypoint.angle * 0.017453292519943295 : 0.0;
    const auto cosine = static_cast<float>(std::cos(radians));
    const auto sine = static_cast<float>(std::sin(radians));
    x_from_u = scale * cosine;
    x_from_v = -scale * sine;
    x = (-scale * cosine + scale * sine) * kTeblidPatch * 0.5f + keypoint.pt.x;
    y_from_u = scale * sine;
    y_from_v = scale * cosine;
    y = (-scale * sine - scale * cosine) * kTeblidPatch * 0.5f + keypoint.pt.y;
  }

  float scale;  ///< side of a patch pixel in the image, px
  float x_from_u, x_from_v, x;
  float y_from_u, y_from_v, y;
};

/// Returns true only if all boxes of a keypoint are inside the image. The farthest corner of a box
/// is at most 0.7 * size from the keypoint, and rounding adds up to 2 px to this distance.
inline bool isFarFromBorder(const cv::KeyPoint& keypoint, const cv::Size& image) {
  constexpr float kMargin = 1.75f / 2;
  constexpr float kLeastSize = 16.f;
  const float margin = keypoint.size * kMargin;
  return keypoint.size >= kLeastSize &&  //
         keypoint.pt.x >= margin && keypoint.pt.x + margin < static_cast<float>(image.width) &&
         keypoint.pt.y >= margin && keypoint.pt.y + margin < static_cast<float>(image.height);
}

/// Values that are the same for all keypoints of one size.
struct TeblidScale {
  /// `keypoint_size` in px; `stride`: values in a row of the integral image.
  TeblidScale(float keypoint_size, int stride);

  float keypoint_size;
  int stride;
  /// Offsets in the integral image from the centre pixel of a box to its corners (upper left, upper
  /// right, lower left, lower right). Indexed by the box radius given in kTeblidTable.
  std::array<std::ptrdiff_t, 4> corners[kTeblidRadii + 1];
  /// A bit is set if the difference of the sums of its two boxes is less than this bound. Indexed
  /// by the position of the bit in the descriptor.
  std::int32_t bound[kTeblidBits];
};

/// For each pair of boxes, computes the difference of their sums, and writes it to the position of
/// the pair's bit in the descriptor. `centres`: centres of the boxes in the order of kTeblidOrder,
/// as indices of the integral image.
inline void compareBoxes(const std::uint32_t* integral, const TeblidScale& scale,
                         const std::int32_t* centres, std::int32_t* differences) {
  int i = 0;
  for (int radius = 1; radius <= kTeblidRadii; ++radius) {
    // With one pointer per corner, a single instruction reads the value at pointer plus centre.
    const std::array<std::ptrdiff_t, 4> at = scale.corners[radius];
    const std::uint32_t* const top_left = integral + at[0];
    const std::uint32_t* const top_right = integral + at[1];
    const std::uint32_t* const bottom_left = integral + at[2];
    const std::uint32_t* const bottom_right = integral + at[3];
    const auto sum = [&](std::ptrdiff_t centre) {
      return top_left[centre] - top_right[centre] - bottom_left[centre] + bottom_right[centre];
    };
    // The sums are read one by one, because gather instructions are no faster, and much slower on
    // many processors. The differences are right even if the sums overflow in large images.
    for (; i < kTeblidOrder.end[radius]; ++i) {
      differences[kTeblidOrder.place[i]] =
          static_cast<std::int32_t>(sum(centres[i]) - sum(centres[kTeblidBits + i]));
    }
  }
}

}  // namespace ktgp_orb::orb
