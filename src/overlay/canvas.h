#pragma once

#include <cstddef>
#include <opencv2/core.hpp>

namespace ktgp_orb::overlay {

/// The image as 8-bit BGR into `region`, which has its size. Throws std::invalid_argument for an
/// image that is neither CV_8UC1 nor CV_8UC3.
void copyAsBgr(const cv::Mat& image, cv::Mat region);

/// Reference left, target right; black below the shorter one.
void drawSideBySide(const cv::Mat& reference, const cv::Mat& target, cv::Mat& canvas);

/// True for `chosen` of `count` indices, evenly spaced.
inline bool isChosen(std::size_t i, std::size_t count, std::size_t chosen) {
  return (i + 1) * chosen / count != i * chosen / count;
}

}  // namespace ktgp_orb::overlay
