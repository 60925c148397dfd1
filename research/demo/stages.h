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

/// Matches the pair with the default options and draws the matches that remain after KNN, TF, GMS
/// and PROSAC: 2 x 2 panels with at most 60 lines each. Matches within 3 px of the truth are blue,
/// others are red. The title of a panel says how many matches there are and how many are right.
cv::Mat drawStages(const KnownPair& pair);

/// The photographs graf1 and graf3 of Debian's opencv-doc (a painted wall, turned by 30 degrees),
/// and their homography. The images are empty if the package is not installed.
KnownPair graffiti();

}  // namespace ktgp_orb::demo
