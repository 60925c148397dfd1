#pragma once

#include <Eigen/Core>
#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

namespace ktgp_orb::mosaic {

/// What the homographies of a camera tell about its motion.
struct Turn {
  enum class Verdict {
    open,   ///< too small a turn, too few frames, or no focal length to tell
    turns,  ///< the camera only turns
    moves,  ///< no turn fits
  };
  Verdict verdict = Verdict::open;
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();  ///< K that fits best
  bool is_estimated = false;                             ///< the homographies have told it
  double off = 0.0;  ///< how far the homographies are off that of a turn, px (rms)
  double degrees =
      0.0;  ///< largest angle to the first frame's optical axis, if they were of a turn
  Eigen::Vector3d axis = Eigen::Vector3d::UnitY();  ///< of the turns, in the first frame's camera
};

/// A homography may be this far off that of a turn, px (rms).
double largestOff(const cv::Size& size);

/// `poses`: homographies of the first frame -> others; `camera`: K, if it is known. Otherwise the
/// focal length is estimated, with square pixels and the principal point in the middle.
Turn testTurn(const std::vector<Eigen::Matrix3d>& poses, const cv::Size& size,
              const std::optional<Eigen::Matrix3d>& camera);

}  // namespace ktgp_orb::mosaic
