#pragma once

#include <map>
#include <string>

namespace ktgp_orb::tools {

/// The text of each config/NAME.yaml, by its name.
const std::map<std::string, std::string>& presets();

}  // namespace ktgp_orb::tools
