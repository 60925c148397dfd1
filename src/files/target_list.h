#pragma once

#include <functional>
#include <string>
#include <vector>

#include "ktgp_orb/target_finder.h"

namespace ktgp_orb {

/// An entry of a target list: like Target, but with the names of image files instead of images.
struct TargetEntry {
  std::string id;
  std::vector<std::string> files;
  double width = 0.0;  ///< width of the target, m; 0: not known
  std::string frame;
  /// Where the entry comes from, for error messages: the list and line, or the file in the folder.
  std::string place;
};

/// Reads a folder with one image per target (the file name without its ending is the id), or a YAML
/// list:
///   - {id: door, image: door.png, width: 0.8, frame: door}
///   - {id: map, images: [day.jpg, night.jpg]}
/// File names in the list are relative to the list's folder; the returned entries have absolute
/// names. A folder is sorted by id. Throws std::invalid_argument with `path` and the reason.
std::vector<TargetEntry> readTargetList(const std::string& path);

/// Writes the entries as a YAML list.
std::string textOfTargetList(const std::vector<TargetEntry>& entries);

/// Reads the images of an entry and calls `add` with the target. If an image cannot be read or
/// `add` throws, throws std::invalid_argument with the entry's place, its id and the reason.
void addTarget(const TargetEntry& entry, const std::function<void(const Target&)>& add);

/// Reads the images of all entries and adds the targets to `finder`. For each target that was
/// refused, returns a text that says why.
std::vector<std::string> addTargets(const std::vector<TargetEntry>& entries, TargetFinder& finder);

}  // namespace ktgp_orb
