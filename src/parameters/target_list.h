#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/target_finder.h"

namespace ktgp_orb {

/// A target of a list: as Target, with files instead of images.
struct TargetEntry {
  std::string id;
  std::vector<std::string> files;
  double width = 0.0;  ///< m; 0: not known
  std::string frame;
};

/// A folder of images, one for each target (its name without the ending is the id), or a YAML list:
///   - {id: door, image: door.png, width: 0.8, frame: door}
///   - {id: map, images: [day.jpg, night.jpg]}
/// Names of files are relative to the list. Ordered by id (folder) or as in the list. Throws
/// std::invalid_argument, beginning with `path`, with the reason.
std::vector<TargetEntry> readTargetList(const std::string& path);

/// Writes such a list; throws as writeFile() does.
void writeTargetList(const std::string& path, const std::vector<TargetEntry>& entries);

/// Throws std::invalid_argument with the reason if it cannot be written as a whole; then there is
/// no such file.
void writeFile(const std::string& path, const std::string& bytes);

/// Reads an image as 8-bit grey; throws a std::exception with the name and the reason.
using ReadImage = std::function<cv::Mat(const std::string& file)>;

/// The target of an entry. Throws as `read` does.
Target readTarget(const TargetEntry& entry, const ReadImage& read);

/// Adds the targets; returns the reasons why some were refused.
std::vector<std::string> addTargets(const std::vector<TargetEntry>& entries, const ReadImage& read,
                                    TargetFinder& finder);

}  // namespace ktgp_orb
