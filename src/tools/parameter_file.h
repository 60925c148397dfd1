#pragma once

#include <map>
#include <string>

#include "parameters/parameters.h"

namespace ktgp_orb::tools {

/// Returns the text of a file of parameters, which may be a pipe. Throws std::invalid_argument with
/// the file and the problem.
std::string parameterText(const std::string& file);
/// Reads the parameters from YAML as `rosparam dump` (flat, or below the node's name) or `dynparam
/// dump` write it. Throws std::invalid_argument with `name` and the problem: not YAML, an unknown
/// parameter, a value out of its range.
void readParameters(const std::string& name, const std::string& text, Parameters& parameters);

/// Reads the parameters from config/NAME.yaml, which is built into the program. Throws
/// std::invalid_argument for an unknown name.
void readPreset(const std::string& name, Parameters& parameters);

/// The texts of the files config/NAME.yaml; the key is NAME.
const std::map<std::string, std::string>& presets();
/// The names of all presets, for example "ktgp, robust".
std::string namesOfPresets();

}  // namespace ktgp_orb::tools
