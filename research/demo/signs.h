#pragma once

#include <ktgp_orb/TargetDetections.h>

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace ktgp_orb::demo {

/// A flat target on the ground.
struct Sign {
  std::string id;
  cv::Mat picture;                      ///< 8-bit BGR, in the resolution of the map
  std::vector<Eigen::Matrix3d> places;  ///< pixels of the picture -> pixels of the map
};

/// Three signs below the flight, one of them twice.
std::vector<Sign> drawSigns();

/// Paints every sign at its places.
void paintOnto(const std::vector<Sign>& signs, cv::Mat& map);

/// Writes the pictures and their list, targets.yaml, into a folder that exists. Throws FileError.
void writeSigns(const std::vector<Sign>& signs, const std::string& folder, bool force);
/// The names of the files that writeSigns() writes.
std::vector<std::string> filesOf(const std::vector<Sign>& signs, const std::string& folder);

/// The true corners, homographies and poses of all signs, in the image or not. The instance is the
/// number of the place.
TargetDetections truthOf(const std::vector<Sign>& signs, const std_msgs::Header& image,
                         const Eigen::Matrix3d& image_from_map);

}  // namespace ktgp_orb::demo
