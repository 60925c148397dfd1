#pragma once

#include <cstdint>
#include <vector>

#include "core/targets/frame_search.h"

namespace ktgp_orb::targets {

/// Whether the points by which it was found are spread over most of the part of its picture that
/// has keypoints.
bool coversTexture(const FoundTarget& one, TargetStore& store);

/// Which of the targets are doubtful (non-zero), since another one explains the same part of the
/// frame with as much support or nearly so (FoundPicture::log_false_alarms). This is so in two
/// cases:
/// - Both pictures have a part in common, such as a logo, and only this part of the doubtful one is
///   seen, within the other one. (A target that lies on another one is seen as a whole, and one
///   below it is seen outside of the upper one.)
/// - Both cover nearly the same part of the frame.
std::vector<std::uint8_t> conflicts(const std::vector<FoundTarget>& found, TargetStore& store);

}  // namespace ktgp_orb::targets
