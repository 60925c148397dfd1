#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "growth/reference_frames.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb::targets {

struct StoredTarget;

/// Added around a picture before its keypoints are searched, px: the extractor finds none near the
/// border of an image.
constexpr int kPictureBorder = 48;

/// An image of a target and its keypoints, in px of `image`.
struct TargetPicture {
  cv::Mat image;                ///< 8-bit grey, at most the largest side
  std::vector<cv::Mat> halves;  ///< `image` at half of its size, a quarter ...
  cv::Size full_size;           ///< size of the given image, px
  double scale = 1.0;           ///< factor from `image` to the given image
  growth::ReferenceFrames frames;
  std::size_t own = 0;            ///< keypoints of the image itself; those of its views follow
  StoredTarget* owner = nullptr;  ///< null: not in a store
};

/// Creates the views and extracts their features. `features`, `largest_side`, `views`: see
/// TargetFinderOptions. A very narrow image has no keypoints. Throws std::invalid_argument for an
/// image of another type.
TargetPicture makePicture(const cv::Mat& image, const OrbOptions& orb, int features,
                          int largest_side, int views);

/// `picture.image` with another size. `method`: cv::INTER_AREA moves nothing; cv::INTER_LINEAR
/// takes less time.
void shrink(const TargetPicture& picture, const cv::Size& size, cv::InterpolationFlags method,
            cv::Mat& small);

Eigen::Vector2d middleOf(const cv::Size& image);
/// Width and height of an image where the homography moves its middle to, px.
cv::Size2d sizeIn(const Eigen::Matrix3d& homography, const cv::Size& image);

/// Given image -> `picture.image`, px.
Eigen::Matrix3d toStored(const TargetPicture& picture);

}  // namespace ktgp_orb::targets
