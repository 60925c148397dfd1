#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace ktgp_orb::orb {

/// Sums of the pixels above and left of each corner of a pixel: CV_32S, one row and one column more
/// than the 8-bit grey `image`, modulo 2^32. The buffer of `integral` is reused.
void integralImage(const cv::Mat& image, cv::Mat& integral);

/// The TEBLID-256 descriptor (see teblid_table.h) of a keypoint, from the integral image: 32 bytes,
/// the first bit is the highest of the first byte. The patch of 32 px is scaled to the keypoint's
/// size and rotated by its angle (degrees; negative: not rotated).
///
/// Works for any keypoint: a box that leaves the image is cut at its border, and its mean is over
/// the rest, or over the nearest pixels if nothing is left. The bits equal those of the authors'
/// program (OpenCV's xfeatures2d, scale factor 1).
///
/// This is the reference, in plain C++, for TeblidDescriber.
void describeTeblid(const cv::Mat& integral, const cv::KeyPoint& keypoint,
                    std::uint8_t* descriptor);

}  // namespace ktgp_orb::orb
