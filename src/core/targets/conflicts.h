#pragma once

#include <cstdint>
#include <vector>

#include "core/targets/frame_search.h"

namespace ktgp_orb::targets {

/// Targets may have a part in common, such as a logo. Where only this part is seen, the target is
/// not there: non-zero for each one whose keypoints mostly belong to a better supported target as
/// well, and cover only a part of its picture. (A small target that lies on a larger one is
/// covered.) So is the less supported one of two that cover nearly the same part of the frame.
std::vector<std::uint8_t> conflicts(const std::vector<FoundTarget>& found, TargetStore& store);

}  // namespace ktgp_orb::targets
