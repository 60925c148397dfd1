#pragma once

#include <Eigen/Core>
#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

namespace ktgp_orb::mosaic {

/// Result of testTurn(): whether the camera only turned (rotated on the spot) while it took the
/// frames, or also moved.
struct Turn {
  enum class Verdict {
    open,   ///< not known: too small a turn, too few frames, or camera matrix unknown
    turns,  ///< the camera only turns
    moves,  ///< no pure turn explains the homographies
  };
  Verdict verdict = Verdict::open;
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();  ///< the camera matrix that fits best
  bool is_estimated = false;  ///< `camera` was estimated from the homographies
  double off = 0.0;           ///< deviation of the homographies from a pure turn, px (rms)
  /// Largest angle between the optical axes of the first frame and another frame, in degrees,
  /// assuming that the camera only turned.
  double degrees = 0.0;
  /// Axis of the turn, in the coordinates of the first camera.
  Eigen::Vector3d axis = Eigen::Vector3d::UnitY();
};

/// Largest deviation from a pure turn, px (rms), at which the camera still counts as turning.
double largestOff(const cv::Size& size);

/// Tests whether the camera only turned. `poses`: homographies from the first frame to other
/// frames, px. `size`: size of the frames. `camera`: camera matrix, if it is known. If it is not
/// known or is wrong, the focal length is estimated, assuming square pixels and the principal point
/// in the middle of the image.
Turn testTurn(const std::vector<Eigen::Matrix3d>& poses, const cv::Size& size,
              const std::optional<Eigen::Matrix3d>& camera);

}  // namespace ktgp_orb::mosaic
