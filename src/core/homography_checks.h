#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core/types.hpp>
#include <vector>

namespace ktgp_orb {

/// Corners of the image, in pixels; of the points' bounding box where the size is empty.
std::array<Eigen::Vector2d, 4> imageCorners(const cv::Size& size,
                                            const std::vector<Eigen::Vector2d>& points);

/// True where H could show the plane over the whole image as seen from one side: it turns nothing
/// inside out (det H > 0 with the third coordinate positive) and its horizon, the line that goes to
/// infinity, stays clear of the corners and so of the image between them.
bool keepsPlaneInView(const Eigen::Matrix3d& homography,
                      const std::array<Eigen::Vector2d, 4>& corners);

/// Largest standard deviation, over the corners, of where H maps them: the root of the trace of
/// the propagated covariance of H's first eight entries, H(2,2) = 1. Infinite where undefined.
double cornerDeviation(const Eigen::Matrix3d& homography,
                       const Eigen::Matrix<double, 8, 8>& covariance,
                       const std::array<Eigen::Vector2d, 4>& corners);

}  // namespace ktgp_orb
