#pragma once

#include <ros/node_handle.h>

#include <boost/any.hpp>
#include <string>
#include <vector>

namespace ktgp_orb {

/// Of a parameter that is set; `low` and `high` hold the type it was declared with. Throws
/// std::invalid_argument naming the parameter, its value and its range.
void requireInRange(const std::string& parameter, XmlRpc::XmlRpcValue value, const boost::any& low,
                    const boost::any& high);

/// Checks the parameters that `node` was started with, from a launch file, YAML or the command
/// line, which dynamic_reconfigure would clamp or ignore without a word. Throws as requireInRange.
template <typename Config>
void requireAllInRange(const ros::NodeHandle& node) {
  for (const auto& description : Config::__getParamDescriptions__()) {
    XmlRpc::XmlRpcValue value;
    if (!node.getParam(description->name, value)) continue;
    boost::any low;
    boost::any high;
    description->getValue(Config::__getMin__(), low);
    description->getValue(Config::__getMax__(), high);
    requireInRange(node.resolveName(description->name), value, low, high);
  }
}

/// The same for the matcher, and the choices of the strings.
void requireParametersInRange(const ros::NodeHandle& node);

/// Sets T_w to that of the descriptor where `node` was started with a descriptor and without T_w.
void completeRatioThreshold(const ros::NodeHandle& node);

/// Parameters of the matcher below `node` that nothing reads, misspelt ones for example.
std::vector<std::string> unknownParameters(const ros::NodeHandle& node);

}  // namespace ktgp_orb
