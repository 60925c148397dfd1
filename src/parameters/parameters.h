#pragma once

#include <string>
#include <variant>
#include <vector>

namespace ktgp_orb {

/// The value of every parameter; the defaults come from the table.
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): the order is that of the documents
struct Parameters {
#define KTGP_GROUP(name)
#define KTGP_BOOL(name, value, text, ...) bool name = value;
#define KTGP_INT(name, value, low, high, unit, text, ...) int name = value;
#define KTGP_DOUBLE(name, value, low, high, unit, text, ...) double name = value;
#define KTGP_STRING(name, value, text, ...) std::string name = value;
#define KTGP_CHOICE(name, value, text, choices, ...) std::string name = value;
#include "parameters/table.def"
#include "parameters/table_end.def"
};

/// The range of allowed values of a number; both ends are allowed.
class Limits {
 public:
  Limits() = default;
  Limits(double low, double high);

  /// Returns true if `value` is within the limits; false for NaN.
  bool contains(double value) const;
  /// The limits as text, for example "[0, 1]".
  const std::string& text() const { return text_; }
  double low() const { return low_; }
  double high() const { return high_; }

 private:
  std::string text_;
  double low_ = 0.0;
  double high_ = 0.0;
};

/// A row of the parameter table of a nodelet (parameters/*.def): all that is known about a
/// parameter, except its value.
struct ParameterInfo {
  enum class Kind { boolean, whole, number, text };

  std::string group;  ///< "method", "stage_1_orb", ...
  std::string name;
  Kind kind;
  std::string text;
  std::string unit{};
  Limits limits{};                     ///< limits of a number; not used for other kinds
  std::vector<std::string> choices{};  ///< allowed texts; if empty, any text is allowed

  /// Returns a text that describes the allowed values: "a number in [0, 1]", "range or tf_height",
  /// ...
  std::string expected() const;
};

/// Returns the parameter table of `nodelet`, which is "matcher", "mosaic", "stabilizer", "targets"
/// or "ground_motion". Throws std::invalid_argument for another name.
const std::vector<ParameterInfo>& parametersOf(const std::string& nodelet);

/// Returns the row of the parameter `name`. Throws std::invalid_argument for an unknown nodelet or
/// parameter.
const ParameterInfo& parameterOf(const std::string& nodelet, const std::string& name);

/// A parameter of the matcher, and the member of Parameters that holds its value.
struct ParameterRow : ParameterInfo {
  using Field = std::variant<bool Parameters::*, int Parameters::*, double Parameters::*,
                             std::string Parameters::*>;
  Field field;
};

/// Returns all rows of the matcher's table, in the order of the table.
const std::vector<ParameterRow>& parameterRows();

/// Returns the row of the matcher's parameter `name`, or null if there is none.
const ParameterRow* findParameter(const std::string& name);

/// Sets the parameter of `row` from a text such as "0.66", "true" or "keyframe". Throws
/// std::invalid_argument, with the parameter, the text and what is expected, if the text is not an
/// allowed value.
void setParameter(const ParameterRow& row, const std::string& text, Parameters& parameters);

/// Returns the value of the parameter as a text that setParameter() accepts.
std::string valueText(const ParameterRow& row, const Parameters& parameters);

/// Checks all values. Throws std::invalid_argument, with the parameter, the value and what is
/// expected, for a value outside its limits, NaN, or an unknown choice.
void requireValid(const Parameters& parameters);
/// Checks one value in the same way. The text of the exception begins with `name`.
void requireValid(const ParameterInfo& info, const std::string& name, double value);
void requireValid(const ParameterInfo& info, const std::string& name, const std::string& value);

}  // namespace ktgp_orb
