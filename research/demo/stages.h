#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>

namespace ktgp_orb::demo {

/// Two images (CV_8UC1 or CV_8UC3) with the true homography reference -> target, px.
struct KnownPair {
  cv::Mat reference;
  cv::Mat target;
  Eigen::Matrix3d truth;
};

/// Matches the pair with the default options and draws what is left after KNN, TF, GMS and PROSAC:
/// 2 x 2 panels with at most 60 lines each, blue for matches within 3 px of the truth, red for the
/// others. The title of a panel says how many matches there are and how many are right.
cv::Mat drawStages(const KnownPair& pair);

/// The photographs graf1 and graf3 of Debian's opencv-doc (a painted wall, turned by 30 degrees),
/// with the homography from there. Empty images where the package is not installed.
KnownPair graffiti();

}  // namespace ktgp_orb::demo
