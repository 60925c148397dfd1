#pragma once

#include <map>
#include <string>

#include "parameters/parameters.h"

namespace ktgp_orb::tools {

/// Reads the parameters from a YAML file written by `rosparam dump` (flat, or below the node's
/// name) or `dynparam dump`. Throws std::invalid_argument with the file and the problem: not YAML,
/// an unknown parameter, a value out of its range.
void readParameterFile(const std::string& file, Parameters& parameters);

/// Reads the parameters from config/NAME.yaml, which is built into the program. Throws
/// std::invalid_argument for an unknown name.
void readPreset(const std::string& name, Parameters& parameters);

/// The texts of the files config/NAME.yaml; the key is NAME.
const std::map<std::string, std::string>& presets();
/// The names of all presets, for example "ktgp, robust".
std::string namesOfPresets();

}  // namespace ktgp_orb::tools
