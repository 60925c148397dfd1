#pragma once

#include <set>
#include <string>

#include "parameters/parameters.h"

namespace ktgp_orb::tools {

/// Sets the parameters that a YAML file names, as `rosparam dump` (flat, or below the node's name)
/// and `dynparam dump` write it. Throws std::invalid_argument naming the file and what is wrong in
/// it: no YAML, a name that is no parameter, a value out of its range. Returns the names.
std::set<std::string> readParameterFile(const std::string& file, Parameters& parameters);

/// Sets the parameters of config/NAME.yaml, which is built into the program. Throws
/// std::invalid_argument for another name. Returns the names of those set.
std::set<std::string> readPreset(const std::string& name, Parameters& parameters);

/// "ktgp, robust"
std::string namesOfPresets();

}  // namespace ktgp_orb::tools
