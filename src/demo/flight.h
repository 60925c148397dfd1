#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace ktgp_orb::demo {

constexpr int kImageWidth = 640;
constexpr int kImageHeight = 480;
constexpr double kFocalLength = 525.0;  ///< px; the principal point is the image centre

/// The homography map pixels -> image pixels of the camera `seconds` into the flight: a pinhole
/// above the plane of the map that moves on, turns, rises, sinks and tilts, all smoothly. `shake`:
/// px, root mean square, by which it trembles beside that, three to twelve times a second.
Eigen::Matrix3d imageFromMap(double seconds, double shake = 0.0);

/// What the camera sees for an instant, 8-bit BGR, anti-aliased by twofold oversampling.
cv::Mat render(const cv::Mat& map, const Eigen::Matrix3d& image_from_map);

}  // namespace ktgp_orb::demo
