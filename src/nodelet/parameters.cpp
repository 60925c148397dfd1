#include "nodelet/parameters.h"

#include <boost/any.hpp>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "messages/configuration.h"

namespace ktgp_orb {
namespace {

// Private parameters that are not dynamic: those read by image_transport, those read once at start,
// and those that the matcher stores across a restart.
const char* const kStaticParameters[] = {"image_transport", "queue_size", "reference_was_set"};

[[noreturn]] void refuse(const std::string& parameter, const std::string& value,
                         const std::string& expected) {
  throw std::invalid_argument("parameter " + parameter + " is " + value + "; expected " + expected);
}

/// A double for an int parameter: dynamic_reconfigure would truncate it without a message.
[[noreturn]] void refusePoint(const std::string& parameter, double number) {
  std::ostringstream digits;
  digits.precision(15);
  digits << number;
  if (number != std::floor(number)) refuse(parameter, digits.str(), "a whole number");
  refuse(parameter, digits.str() + ".0, a number with a point",
         "a whole number: write " + digits.str());
}

}  // namespace

void requireInRange(const std::string& parameter, XmlRpc::XmlRpcValue value, const boost::any& low,
                    const boost::any& high) {
  std::ostringstream given;
  value.write(given);
  const bool is_text = value.getType() == XmlRpc::XmlRpcValue::TypeString;
  if (is_text && low.type() != typeid(std::string)) {
    const std::string text = "the text '" + given.str() + "'";
    if (low.type() == typeid(bool)) refuse(parameter, text, "true or false, without quotes");
    const bool has_exponent =
        given.str().find_first_of("eE") != std::string::npos &&
        given.str().find_first_not_of("0123456789.eE+-") == std::string::npos;
    if (!has_exponent) refuse(parameter, text, "a number, without quotes");
    refuse(parameter, text,
           "a number without quotes, and without an exponent: YAML takes 1e3 for a text");
  }
  const auto check = [&](double number, double lowest, double highest) {
    if (number >= lowest && number <= highest) return;
    std::ostringstream range;
    range << "a value in [" << lowest << ", " << highest << "]";
    refuse(parameter, given.str(), range.str());
  };
  const bool is_int = value.getType() == XmlRpc::XmlRpcValue::TypeInt;
  if (low.type() == typeid(double)) {
    if (!is_int && value.getType() != XmlRpc::XmlRpcValue::TypeDouble) {
      refuse(parameter, given.str(), "a number");
    }
    const double number = is_int ? static_cast<int>(value) : static_cast<double>(value);
    check(number, boost::any_cast<double>(low), boost::any_cast<double>(high));
  } else if (low.type() == typeid(int)) {
    if (value.getType() == XmlRpc::XmlRpcValue::TypeDouble) refusePoint(parameter, value);
    if (!is_int) refuse(parameter, given.str(), "a whole number");
    check(static_cast<int>(value), boost::any_cast<int>(low), boost::any_cast<int>(high));
  } else if (low.type() == typeid(bool)) {
    if (value.getType() != XmlRpc::XmlRpcValue::TypeBoolean) {
      refuse(parameter, given.str(), "true or false");
    }
  } else if (value.getType() != XmlRpc::XmlRpcValue::TypeString) {
    refuse(parameter, given.str(), "a string");
  }
}

void requireMode(const ros::NodeHandle& node) {
  std::string mode;
  if (node.getParam("reference_mode", mode)) referenceModeFrom(mode);
}

void completeRatioThreshold(const ros::NodeHandle& node) {
  const Parameters usual;
  std::string descriptor;
  if (node.hasParam("T_w") || !node.getParam("descriptor", descriptor)) return;
  node.setParam("T_w", followDescriptor(usual.T_w, usual.descriptor, descriptor));
}

std::vector<std::string> unknownParameters(const ros::NodeHandle& node,
                                           std::set<std::string> known) {
  known.insert(std::begin(kStaticParameters), std::end(kStaticParameters));
  const std::string prefix = node.getNamespace() + "/";
  std::vector<std::string> all;
  std::vector<std::string> unknown;
  node.getParamNames(all);
  for (const std::string& name : all) {
    if (name.compare(0, prefix.size(), prefix) != 0) continue;
    const std::string own = name.substr(prefix.size());
    // Plugins have their own parameters below a topic, such as matches_image/compressed.
    if (own.find('/') == std::string::npos && known.count(own) == 0) unknown.push_back(name);
  }
  return unknown;
}

}  // namespace ktgp_orb
