#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/warps.h"

namespace ktgp_orb::tools {

/// Two images of which the truth is known.
struct ImagePair {
  std::string set;   ///< e.g. "leuven"
  std::string name;  ///< e.g. "1-2"
  std::string reference;
  std::string target;
  Eigen::Matrix3d homography;  ///< reference to target, px
  /// Where present, both images are rendered from the picture `reference`, which is also `target`.
  std::optional<Warp> warp{};
};

/// What could be used and what could not.
struct Dataset {
  std::vector<ImagePair> pairs;
  std::vector<std::string> problems;  ///< one line each, beginning with the file's name
};

/// Adds the pairs found at `path`:
/// - an Oxford/VGG folder (img1.ppm ... img6.ppm with H1to2p ... H1to6p),
/// - an HPatches folder (1.ppm ... 6.ppm with H_1_2 ... H_1_6),
/// - a folder of such folders, in the order of their names, or
/// - a text file with `name imageA imageB homographyA->B` a line (paths relative to it, no blanks
///   in names, # begins a comment).
/// Image 1 is the reference. A file that is missing or broken becomes a problem; the rest goes on.
void addPairs(const std::string& path, Dataset& dataset);

/// Adds `count` warps of the pictures at `paths` (images, or folders of images), each picture in
/// turn, as the set `name`: "small", "medium" or "large". Throws std::invalid_argument for another
/// name. A path that is missing or holds no image becomes a problem.
void addWarps(const std::string& name, const std::vector<std::string>& paths, int count,
              std::uint64_t seed, Dataset& dataset);

}  // namespace ktgp_orb::tools
