#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>

#include "ktgp_orb/features.h"

namespace ktgp_orb::util {

/// Standard deviation of the rounding error of a keypoint's position, along each axis, in px of the
/// finest pyramid level. Keypoints are found at whole pixels of their level.
constexpr double kKeypointRounding = 0.288675;  // 1/sqrt(12)

[[noreturn]] void refuseKeypoint(const Features& features, std::int32_t index, const char* frame);
/// Throws std::invalid_argument if a match refers to a keypoint that does not exist. `frame`: name
/// of the frame for the error text, "reference" or "target".
inline void requireKeypoint(const Features& features, std::int32_t index, const char* frame) {
  if (index < 0 || static_cast<std::size_t>(index) >= features.size()) {
    refuseKeypoint(features, index, frame);
  }
}

/// Position of keypoint `index`, px, as an OpenCV point for drawing and messages. The keypoint must
/// exist.
inline const cv::Point2f& imagePoint(const Features& features, std::int32_t index) {
  return features.keypoints[static_cast<std::size_t>(index)].pt;
}

/// Position of keypoint `index`, px, as an Eigen vector. The keypoint must exist.
inline Eigen::Vector2d position(const Features& features, std::int32_t index) {
  const cv::Point2f& p = imagePoint(features, index);
  return {p.x, p.y};
}

}  // namespace ktgp_orb::util
