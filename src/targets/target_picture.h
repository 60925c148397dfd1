#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "growth/reference_frames.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb::targets {

struct StoredTarget;

/// Width of the border that is added around a picture before its keypoints are extracted, px. The
/// extractor finds no keypoints near the border of an image.
constexpr int kPictureBorder = 48;

/// An image of a target and its keypoints, in px of `image`.
struct TargetPicture {
  cv::Mat image;                ///< 8-bit grey, shrunk if longer than largest_side
  std::vector<cv::Mat> halves;  ///< `image` at a half, a quarter and so on of its size
  cv::Size full_size;           ///< size of the image before it was shrunk, px
  double scale = 1.0;           ///< size of `image` divided by full_size
  growth::ReferenceFrames frames;
  std::size_t own = 0;  ///< number of keypoints of `image`; the keypoints of its views follow them
  StoredTarget* owner = nullptr;  ///< its target in the store; null: not in a store
};

/// Shrinks the image if it is larger than `largest_side`, creates its views, and extracts their
/// features. `features`, `largest_side`, `views`: see TargetFinderOptions. A very narrow image gets
/// no keypoints. Throws std::invalid_argument if `image` is not 8-bit grey or is empty.
TargetPicture makePicture(const cv::Mat& image, const OrbOptions& orb, int features,
                          int largest_side, int views);

/// Resizes `picture.image` to `size`. `method`: cv::INTER_AREA does not shift the content of the
/// image; cv::INTER_LINEAR is faster.
void shrink(const TargetPicture& picture, const cv::Size& size, cv::InterpolationFlags method,
            cv::Mat& small);

Eigen::Vector2d middleOf(const cv::Size& image);
/// Returns the width and height, px, of an image after the homography has mapped it, computed from
/// the scale of the homography at the middle of the image.
cv::Size2d sizeIn(const Eigen::Matrix3d& homography, const cv::Size& image);

/// The map from the user's image to `picture.image`, px.
Eigen::Matrix3d toStored(const TargetPicture& picture);

}  // namespace ktgp_orb::targets
