#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace ktgp_orb::evaluation {

/// Value of a CV_32F image at (x, y) px, interpolated between the four nearest pixels in full
/// precision (cv::remap and cv::warpPerspective round positions to 1/32 px). Requires 0 <= x <=
/// width - 1, 0 <= y <= height - 1.
float sampleBilinear(const cv::Mat& image, double x, double y);

/// Whether sampleBilinear is defined at (x, y).
bool isInside(const cv::Size& size, double x, double y);

/// Renders `source` (CV_32F) as a camera sees it: pixel u of the result (CV_32F) is the mean of
/// `source` over the square of side 1 px around u, like a pixel of a sensor. So nothing aliases,
/// unless the view shrinks the source more than 16 times. `source_from_view` maps pixels of the
/// view to pixels of the source. Pixels outside the source or beyond the horizon are 0.
cv::Mat renderView(const cv::Mat& source, const Eigen::Matrix3d& source_from_view,
                   const cv::Size& size);

}  // namespace ktgp_orb::evaluation
