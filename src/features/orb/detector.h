#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "features/orb/kernels.h"

namespace ktgp_orb::orb {

/// Buffers of fastCorners for one thread.
struct FastScratch {
  std::vector<std::uint8_t> scores;
  std::vector<std::int32_t> maxima;
};

/// Finds the FAST-9 corners of the rows [first_row, last_row) of `image`, suppresses non-maxima,
/// and appends the remaining corners row by row and from left to right. The response of a corner is
/// its FAST score. All corners are at least kEdgeMargin px from the border; the image must be
/// larger than these margins, and the rows must lie between them.
void fastCorners(const cv::Mat& image, int first_row, int last_row, int threshold,
                 const OrbKernels& kernels, FastScratch& scratch,
                 std::vector<cv::KeyPoint>& corners);

/// The pixel of an 8-bit image at a point with integer coordinates.
inline const std::uint8_t* pixelAt(const cv::Mat& image, const cv::Point2f& point) {
  return image.ptr<std::uint8_t>(static_cast<int>(point.y)) + static_cast<int>(point.x);
}

/// Returns the Harris response of a pixel.
inline float harrisResponse(const cv::Mat& image, const OrbKernels& kernels,
                            const cv::Point2f& point) {
  return kernels.harris(pixelAt(image, point), static_cast<std::ptrdiff_t>(image.step));
}

/// Angle of the vector (x, y) in degrees in [0, 360], accurate to 0.01; 0 for the null vector.
///
/// Uses the polynomial of cv::fastAtan2, and equals its result bit for bit on x86-64. OpenCV's own
/// result depends on the compiler: GCC for arm64 fuses multiplications with additions, so that four
/// angles in a hundred differ in the last bit.
float vectorAngle(float y, float x);

/// Angle, in degrees in [0, 360), of the vector from a pixel to the intensity centroid around it
/// (Rublee et al., section 3.2).
float intensityCentroidAngle(const cv::Mat& image, const OrbKernels& kernels,
                             const cv::Point2f& point);

}  // namespace ktgp_orb::orb
