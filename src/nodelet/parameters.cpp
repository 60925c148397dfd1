#include "nodelet/parameters.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <sstream>
#include <stdexcept>

#include "parameters/near_name.h"

namespace ktgp_orb {
namespace {

using Kind = ParameterInfo::Kind;

// Private parameters that are not dynamic. The package image_transport reads image_transport. The
// node reads queue_size once at start. The matcher sets reference_was_set, so that it can report
// after a restart that a reference was lost.
const char* const kStaticParameters[] = {"image_transport", "queue_size", "reference_was_set"};

[[noreturn]] void refuse(const std::string& parameter, const std::string& value,
                         const std::string& expected) {
  throw std::invalid_argument("parameter " + parameter + " is " + value + "; expected " + expected);
}

/// Refuses a double for an int parameter, because dynamic_reconfigure would silently truncate it.
[[noreturn]] void refusePoint(const std::string& parameter, double number) {
  std::ostringstream digits;
  digits.precision(15);
  digits << number;
  if (number != std::floor(number)) refuse(parameter, digits.str(), "a whole number");
  refuse(parameter, digits.str() + ".0, a number with a point",
         "a whole number: write " + digits.str());
}

/// Refuses a text that is given for a number or a boolean. YAML 1.1 reads 1e3 as a text, so the
/// message shows the number in plain digits.
[[noreturn]] void refuseText(const std::string& parameter, const std::string& text, Kind kind) {
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  const bool is_number = !text.empty() && *end == '\0' && std::isfinite(number);
  const std::string value = "the text '" + text + "'";
  if (kind == Kind::boolean) refuse(parameter, value, "true or false, without quotes");
  if (!is_number) refuse(parameter, value, "a number, without quotes");
  std::ostringstream plain;
  plain.precision(15);
  plain << std::fixed << number;
  std::string digits = plain.str();
  digits.erase(digits.find_last_not_of('0') + 1);
  if (digits.back() == '.') digits.pop_back();
  refuse(parameter, value, "a number: without quotes, and as " + digits);
}

void requireUsableValue(const ParameterInfo& info, const std::string& name,
                        XmlRpc::XmlRpcValue value) {
  std::ostringstream given;
  value.write(given);
  const auto type = value.getType();
  const bool is_int = type == XmlRpc::XmlRpcValue::TypeInt;
  const bool is_double = type == XmlRpc::XmlRpcValue::TypeDouble;
  const bool is_text = type == XmlRpc::XmlRpcValue::TypeString;
  if (is_text && info.kind != Kind::text) refuseText(name, value, info.kind);
  switch (info.kind) {
    case Kind::boolean:
      if (type != XmlRpc::XmlRpcValue::TypeBoolean) refuse(name, given.str(), info.expected());
      return;
    case Kind::whole:
      if (is_double) refusePoint(name, value);
      if (!is_int) refuse(name, given.str(), info.expected());
      return requireValid(info, "parameter " + name, static_cast<int>(value));
    case Kind::number:
      if (!is_int && !is_double) refuse(name, given.str(), info.expected());
      return requireValid(info, "parameter " + name,
                          is_int ? static_cast<int>(value) : static_cast<double>(value));
    case Kind::text:
      if (!is_text) refuse(name, given.str(), info.expected());
      return requireValid(info, "parameter " + name, static_cast<std::string>(value));
  }
}

}  // namespace

void requireUsable(const ros::NodeHandle& node, const std::string& nodelet) {
  for (const ParameterInfo& info : parametersOf(nodelet)) {
    XmlRpc::XmlRpcValue value;
    if (node.getParam(info.name, value)) {
      requireUsableValue(info, node.resolveName(info.name), value);
    }
  }
}

void requireValue(const ParameterInfo& info, const boost::any& value) {
  const std::string name = "parameter " + info.name;
  if (const auto* number = boost::any_cast<double>(&value)) requireValid(info, name, *number);
  if (const auto* text = boost::any_cast<std::string>(&value)) requireValid(info, name, *text);
}

std::vector<std::string> warningsOfUnknown(const ros::NodeHandle& node,
                                           const std::string& nodelet) {
  const std::string prefix = node.getNamespace() + "/";
  std::vector<std::string> known(std::begin(kStaticParameters), std::end(kStaticParameters));
  for (const ParameterInfo& info : parametersOf(nodelet)) known.push_back(info.name);
  std::vector<std::string> all;
  std::vector<std::string> warnings;
  node.getParamNames(all);
  for (const std::string& name : all) {
    if (name.compare(0, prefix.size(), prefix) != 0) continue;
    const std::string own = name.substr(prefix.size());
    const std::string last = own.substr(own.rfind('/') + 1);
    const bool is_known = std::find(known.begin(), known.end(), last) != known.end();
    if (last != own) {
      // Plugins have their own parameters below a topic, such as matches_image/compressed.
      if (!is_known) continue;
      warnings.push_back("parameter " + name + " has no effect on this node; expected ");
      warnings.back().append(prefix).append(last);
      continue;
    }
    if (is_known) continue;
    warnings.push_back("parameter " + name + " is not known to this node and has no effect" +
                       hintOnName(own, known));
  }
  return warnings;
}

}  // namespace ktgp_orb
