#pragma once

#include <string>

#include "targets/target_picture.h"

namespace ktgp_orb::targets {

/// How a picture looks like itself in another pose, such as "turned by 180 degrees" (a playing
/// card, a chessboard) or "moved by 12 % of its width" (a facade). Then no search can tell which of
/// the poses it is. Empty if it does not.
std::string ambiguityOf(const TargetPicture& picture);

}  // namespace ktgp_orb::targets
