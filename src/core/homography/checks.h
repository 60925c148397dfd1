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

/// How uncertain H is: largest standard deviation over the corners of where H maps them, in the
/// target, and of where H maps them back from there, in the reference.
struct CornerDeviation {
  double target = 0.0;
  double reference = 0.0;
};

/// The root of the trace of the covariance propagated from that of H's first eight entries, with
/// H(2,2) = 1, in the units of H. Infinite where undefined.
CornerDeviation cornerDeviation(const Eigen::Matrix3d& homography,
                                const Eigen::Matrix<double, 8, 8>& covariance,
                                const std::array<Eigen::Vector2d, 4>& corners);

}  // namespace ktgp_orb
