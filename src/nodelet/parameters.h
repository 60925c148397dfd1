#pragma once

#include <ros/node_handle.h>

#include <boost/any.hpp>
#include <string>
#include <vector>

#include "parameters/parameters.h"

namespace ktgp_orb {

/// Checks types, ranges and choices of the initial parameters below `node`, from a launch file,
/// YAML or the command line. We check them ourselves, because dynamic_reconfigure clamps or ignores
/// wrong parameters without a message. Throws std::invalid_argument; the text names the parameter,
/// its value and what is expected. `nodelet`: see parametersOf().
void requireUsable(const ros::NodeHandle& node, const std::string& nodelet);

/// A warning for each parameter below `node` that the nodelet does not know, with the known
/// parameter that is spelt most like it, and for each known one in a namespace below `node`, where
/// a file with one level too many puts it. (ROS does not warn about unknown parameters.)
std::vector<std::string> warningsOfUnknown(const ros::NodeHandle& node, const std::string& nodelet);

/// Checks what dynamic_reconfigure does not check: that numbers are finite, and that texts are
/// among the choices. Throws like requireUsable.
void requireValue(const ParameterInfo& info, const boost::any& value);
template <typename Config>
void requireUsable(const Config& config, const std::string& nodelet) {
  for (const ParameterInfo& info : parametersOf(nodelet)) {
    for (const auto& description : Config::__getParamDescriptions__()) {
      if (description->name != info.name) continue;
      boost::any value;
      description->getValue(config, value);
      requireValue(info, value);
    }
  }
}

}  // namespace ktgp_orb
