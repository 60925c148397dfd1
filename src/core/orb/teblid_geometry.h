#pragma once

#include <cmath>
#include <opencv2/core.hpp>

#include "core/orb/teblid_table.h"

namespace ktgp_orb::orb {

/// Position of TEBLID's patch in the image: point (u, v) of the patch is at (x_from_u * u +
/// x_from_v * v + x, y_from_u * u + y_from_v * v + y), in px. The order of the operations, each
/// rounded to single precision, is part of the descriptor's definition.
struct TeblidPlacement {
  explicit TeblidPlacement(const cv::KeyPoint& keypoint) : scale(keypoint.size / kTeblidPatch) {
    const double radians = keypoint.angle >= 0 ? keypoint.angle * 0.017453292519943295 : 0.0;
    const auto cosine = static_cast<float>(std::cos(radians));
    const auto sine = static_cast<float>(std::sin(radians));
    constexpr float kHalf = 0.5f;
    x_from_u = scale * cosine;
    x_from_v = -scale * sine;
    x = (-scale * cosine + scale * sine) * kTeblidPatch * kHalf + keypoint.pt.x;
    y_from_u = scale * sine;
    y_from_v = scale * cosine;
    y = (-scale * sine - scale * cosine) * kTeblidPatch * kHalf + keypoint.pt.y;
  }

  float scale;  ///< px of the image per px of the patch
  float x_from_u, x_from_v, x;
  float y_from_u, y_from_v, y;
};

/// Whether all boxes of a keypoint are inside the image, with a margin: the farthest corner is 0.7
/// * size from the keypoint, and rounding adds up to 2 px.
inline bool isFarFromBorder(const cv::KeyPoint& keypoint, const cv::Size& image) {
  constexpr float kMargin = 1.75f / 2;
  constexpr float kLeastSize = 16.f;
  const float margin = keypoint.size * kMargin;
  return keypoint.size >= kLeastSize &&  //
         keypoint.pt.x >= margin && keypoint.pt.x + margin < static_cast<float>(image.width) &&
         keypoint.pt.y >= margin && keypoint.pt.y + margin < static_cast<float>(image.height);
}

}  // namespace ktgp_orb::orb
