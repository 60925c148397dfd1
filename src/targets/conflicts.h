#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "targets/frame_search.h"
#include "targets/target_picture.h"

namespace ktgp_orb::targets {

/// How a picture looks like itself in another pose, such as "turned by 180 degrees" (a playing
/// card, a chessboard) or "moved by 12 % of its width" (a facade). Then no search can tell which of
/// the poses it is. Empty if it does not.
std::string ambiguityOf(const TargetPicture& picture);

/// Which of the targets are doubtful (non-zero), since another one explains the same part of the
/// frame with as much support or nearly so (FoundTarget::log_false_alarms). This is so in two
/// cases:
/// - Both pictures have a part in common, such as a logo, and only this part of the doubtful one is
///   seen, within the other one. (A target that lies on another one is seen as a whole and looks
///   like its picture as much as the other one does; one below it is seen outside of it.)
/// - Both cover nearly the same part of the frame.
std::vector<std::uint8_t> conflicts(const std::vector<FoundTarget>& found, TargetStore& store);

/// Whether the target and a picture, in which it was found, show nearly the same part of the scene,
/// and not only have a part in common, such as the upper half of a sign.
bool showsTheSame(const FoundTarget& found, const TargetPicture& picture, TargetStore& store);

}  // namespace ktgp_orb::targets
