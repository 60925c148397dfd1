#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "motion/camera_pose.h"

namespace ktgp_orb::demo {

constexpr int kImageWidth = 640;
constexpr int kImageHeight = 480;
constexpr double kFocalLength = 525.0;  ///< px; the principal point is the image centre

constexpr double kMetre = 0.2;  ///< size of a pixel of the map, m

/// How the camera flies.
struct Manner {
  double shake = 0.0;  ///< px, root mean square, of an additional shake with three to twelve hertz
  double tilt = 10.0;  ///< degrees, largest pitch; the largest roll is 0.8 of it
};

/// Pose of the camera `seconds` into the flight, in a frame of the ground: x as in the map, y up in
/// the map, and the origin in the middle of the map.
motion::CameraPose poseAt(double seconds, const Manner& manner);

/// K of the camera, px.
Eigen::Matrix3d intrinsics();

/// The homography map pixels -> image pixels of the camera `seconds` into the flight: a pinhole
/// above the plane of the map that moves, turns, rises, sinks and tilts smoothly.
Eigen::Matrix3d imageFromMap(double seconds, const Manner& manner = {});

/// A frame with zero exposure time, 8-bit BGR, anti-aliased by twofold oversampling.
cv::Mat render(const cv::Mat& map, const Eigen::Matrix3d& image_from_map);

}  // namespace ktgp_orb::demo
