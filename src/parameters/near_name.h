#pragma once

#include <string>
#include <vector>

namespace ktgp_orb {

/// The end of a message about an unknown name: "; did you mean T_w?" for the one of `names` that
/// is spelt most like `name`, such as "t_w". Empty if none is spelt like it.
std::string hintOnName(const std::string& name, const std::vector<std::string>& names);

}  // namespace ktgp_orb
