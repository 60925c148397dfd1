#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "targets/frame_search.h"
#include "targets/target_picture.h"

namespace ktgp_orb::targets {

/// Describes another pose in which the picture looks like itself, such as "turned by 180 degrees"
/// (a playing card, a chessboard) or "moved by 12 % of its width" (a facade). No search can tell
/// these poses apart. Empty if there is no such pose.
std::string ambiguityOf(const TargetPicture& picture);

/// Returns for each target in `found` whether it is doubtful (non-zero). A target is doubtful if
/// another target explains the same part of the frame at least nearly as well (see
/// FoundTarget::log_false_alarms). Two cases:
/// - Both pictures have a part in common, such as a logo. Only this part of the doubtful target is
/// seen, inside the other target. (A target in front of the other is not doubtful: it is seen as a
/// whole and looks like its picture as much as the other does. A target behind the other is not
/// doubtful either: parts of it are seen outside of the other.)
/// - Both targets cover nearly the same part of the frame.
std::vector<std::uint8_t> conflicts(const std::vector<FoundTarget>& found, TargetStore& store);

/// `found`: a target that was found in `picture`. Returns true if both show nearly the same part of
/// the scene. A common part, such as the upper half of a sign, is not enough.
bool showsTheSame(const FoundTarget& found, const TargetPicture& picture, TargetStore& store);

/// Returns true if both pictures, as a whole and in one of four rotations, show the same. This also
/// compares pictures that are too small for a search, which needs keypoints.
bool showTheSame(const TargetPicture& known, const TargetPicture& picture);

}  // namespace ktgp_orb::targets
