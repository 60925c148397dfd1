#pragma once

#include <ros/node_handle.h>

#include <string>
#include <vector>

namespace ktgp_orb {

/// Checks the parameters that `node` was started with, from a launch file, YAML or the command
/// line, which dynamic_reconfigure would clamp or ignore without a word. Throws
/// std::invalid_argument naming the parameter, its value and its range or choices.
void requireParametersInRange(const ros::NodeHandle& node);

/// Parameters below `node` that nothing reads, misspelt ones for example.
std::vector<std::string> unknownParameters(const ros::NodeHandle& node);

}  // namespace ktgp_orb
