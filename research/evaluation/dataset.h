#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/warps.h"

namespace ktgp_orb::evaluation {

/// A point of the reference and its position in the target, px.
struct AnnotatedPoint {
  Eigen::Vector2d reference = Eigen::Vector2d::Zero();
  Eigen::Vector2d target = Eigen::Vector2d::Zero();
};

/// Two images with known truth.
struct ImagePair {
  std::string set;   ///< e.g. "leuven"
  std::string name;  ///< e.g. "1-2"
  std::string reference;
  std::string target;
  Eigen::Matrix3d homography;  ///< reference to target, px
  /// If present, these points are the truth, and `homography` is fitted to them.
  std::vector<AnnotatedPoint> points{};
  /// If present, both images are rendered from the picture `reference`, which is also `target`.
  std::optional<Warp> warp{};
};

/// The usable pairs, and the problems of the unusable pairs.
struct Dataset {
  std::vector<ImagePair> pairs;
  std::vector<std::string> problems;        ///< one line each, beginning with the file's name
  std::vector<std::string> files;           ///< all files that are read
  std::map<std::string, std::string> sets;  ///< full paths by the names of the sets
};

/// The name of the set at `path`: its last part, and as many of its parents as tell it from the
/// other `sets` (full paths by names), to which it is added. Throws std::invalid_argument if the
/// same path is among these.
std::string nameOfSet(const std::string& path, std::map<std::string, std::string>& sets);

/// Adds the pairs found at `path`:
/// - an Oxford/VGG folder (img1.ppm ... img6.ppm with H1to2p ... H1to6p, and more if they exist:
///   further images, and homographies of other images than the first),
/// - an HPatches folder (1.ppm ... 6.ppm with H_1_2 ... H_1_6),
/// - a folder of the Extreme View Dataset (1/NAME.png, 2/NAME.png and h/NAME.txt),
/// - a folder of annotated pairs (NAMEA.png, NAMEB.png and NAME.points; see readPoints),
/// - a folder of such folders, in the order of their names, or
/// - a text file with a line `name imageA imageB truth` per pair; the truth is a homography A->B,
///   or annotated points if its name ends in .points. Paths are relative to the file, without
///   blanks; # begins a comment.
/// Image 1 is the reference. A missing or broken file, an image without its truth, and a subfolder
/// that is none of these become problems, and the rest is used. Images end in .ppm, .pgm, .png,
/// .jpg, .jpeg, .tif, .tiff or .bmp, also in upper case. Throws std::invalid_argument if a set is
/// given twice.
void addPairs(const std::string& path, Dataset& dataset);

/// Adds `count` warps of the pictures at `paths` (images, or folders of images) as the set `name`,
/// which warpLimits() must know. The pictures are used in turn. Throws std::invalid_argument for an
/// unknown name. A missing path, or a path without an image, becomes a problem.
void addWarps(const std::string& name, const std::vector<std::string>& paths, int count,
              std::uint64_t seed, Dataset& dataset);

}  // namespace ktgp_orb::evaluation
