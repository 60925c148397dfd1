#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace ktgp_orb::demo {

constexpr int kImageWidth = 640;
constexpr int kImageHeight = 480;
constexpr double kFocalLength = 525.0;  ///< px; the principal point is the image centre

/// The homography map pixels -> image pixels of the camera `seconds` into the flight: a pinhole
/// above the plane of the map that moves, turns, rises, sinks and tilts smoothly. `shake`: px, root
/// mean square, of an additional shake with three to twelve hertz.
Eigen::Matrix3d imageFromMap(double seconds, double shake = 0.0);

/// A frame with zero exposure time, 8-bit BGR, anti-aliased by twofold oversampling.
cv::Mat render(const cv::Mat& map, const Eigen::Matrix3d& image_from_map);

}  // namespace ktgp_orb::demo
