#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "ktgp_orb/target_finder.h"

/// Evaluation of targets in labelled photographs and videos, see doc/targets.md.
namespace ktgp_orb::evaluation {

/// Sizes at which each labelled image is searched by itself; 1: not resized.
constexpr std::array<double, 5> kLabelledSizes{1.0, 0.5, 0.35, 0.25, 0.18};
constexpr double kFoundWithin = 5.0;         ///< px of the searched image, for the mean error
constexpr double kWrongTargetBeyond = 15.0;  ///< px; a larger mean error is a wrong answer

/// One target in one photograph or video.
struct LabelledTarget {
  std::string target;      ///< file in the folder; its name without the ending is the id
  std::string source;      ///< photograph or video in the folder
  std::size_t frames = 0;  ///< frames with a label that says where the target is
  std::array<std::size_t, kLabelledSizes.size()> found{};
  std::size_t near = 0;   ///< frames found within kWrongTargetBeyond, at full size
  std::size_t fixed = 0;  ///< labelled frames found by the matcher in fixed mode with its defaults
  /// Number of wrong answers, also of fixed mode: the error is beyond kWrongTargetBeyond, or a
  /// label says that the target is not there.
  std::size_t wrong = 0;
  /// Number of frames of a video, which is also searched from its first to its last frame.
  std::size_t all_frames = 0;
  std::size_t followed = 0;     ///< labelled frames in which the target was found
  std::size_t longest_gap = 0;  ///< most successive frames without an answer
  std::size_t others = 0;       ///< answers with the id of a target that is not labelled there
};

struct LabelledTargets {
  std::vector<LabelledTarget> rows;
  std::vector<std::string> problems;  ///< one line each, beginning with the file's name
  std::array<double, kLabelledSizes.size()> milliseconds{};  ///< median of the frames of videos
};

/// Searches for all targets of FOLDER/labels.json in all its photographs and videos. The file is an
/// object with `"TARGET IMAGE": {"target": points, "image": points}` for a photograph and
/// `"TARGET VIDEO": {"target": points, "frames": {"NUMBER": points, ...}}` for a video, and may
/// have a "note". Points are [x, y] in px, origin at the centre of the top-left pixel; `[]`: the
/// target is not in the image. Labels beyond the end of a video, and a video that cannot be read,
/// are problems and do not count. Throws files::FileError.
LabelledTargets searchLabelled(const std::string& folder, const TargetFinderOptions& options);

/// A table for the terminal.
std::string toTable(const LabelledTargets& searched);

}  // namespace ktgp_orb::evaluation
