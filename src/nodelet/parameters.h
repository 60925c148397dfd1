#pragma once

#include <ros/node_handle.h>

#include <boost/any.hpp>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace ktgp_orb {

/// Checks a parameter if it is set; `low` and `high` have its declared type. Throws
/// std::invalid_argument with the parameter, its value and its range.
void requireInRange(const std::string& parameter, XmlRpc::XmlRpcValue value, const boost::any& low,
                    const boost::any& high);

/// Checks the initial parameters of `node`, from a launch file, YAML or the command line;
/// dynamic_reconfigure would clamp or ignore wrong ones without a message. Throws as
/// requireInRange.
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

/// Checks that reference_mode is a mode. Throws std::invalid_argument.
void requireMode(const ros::NodeHandle& node);

/// Sets T_w to the default of the descriptor if `node` was started with a descriptor and without
/// T_w.
void completeRatioThreshold(const ros::NodeHandle& node);

/// Throws std::invalid_argument with the name of a number of `config` that is NaN or infinite;
/// dynamic_reconfigure does not clamp these.
template <typename Config>
void requireFinite(const Config& config) {
  for (const auto& description : Config::__getParamDescriptions__()) {
    boost::any value;
    description->getValue(config, value);
    const auto* number = boost::any_cast<double>(&value);
    if (number == nullptr || std::isfinite(*number)) continue;
    throw std::invalid_argument("parameter " + description->name + " is " +
                                std::to_string(*number) + "; expected a number");
  }
}

/// Parameters below `node` that are not in `known` and not used, for example misspelt ones.
std::vector<std::string> unknownParameters(const ros::NodeHandle& node,
                                           std::set<std::string> known);
template <typename Config>
std::vector<std::string> unknownParameters(const ros::NodeHandle& node) {
  std::set<std::string> known;
  for (const auto& description : Config::__getParamDescriptions__()) {
    known.insert(description->name);
  }
  return unknownParameters(node, std::move(known));
}

}  // namespace ktgp_orb
