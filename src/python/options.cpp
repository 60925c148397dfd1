#include "python/options.h"

#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "parameters/near_name.h"
#include "parameters/options.h"
#include "tools/parameter_file.h"
#include "util/format.h"

namespace ktgp_orb::python {
namespace {

namespace py = pybind11;

bool obeys(Scope scope, const ParameterRow& row) {
  static const std::set<std::string> of_sequence{"reference_mode", "max_reference_age",
                                                 "search_radius", "views"};
  if (of_sequence.count(row.name) != 0) return scope == Scope::sequence;
  return row.name == "threads" || row.group == "method" || row.group.rfind("stage_", 0) == 0;
}

std::vector<std::string> namesOf(Scope scope) {
  std::vector<std::string> names;
  for (const ParameterRow& row : parameterRows()) {
    if (obeys(scope, row)) names.push_back(row.name);
  }
  return names;
}

std::string textOf(const ParameterRow& row, const py::handle& given) {
  // If the value is a NumPy scalar, item() converts it to a Python number.
  const bool is_scalar = py::hasattr(given, "dtype") && py::hasattr(given, "item");
  const auto value =
      is_scalar ? py::object(given.attr("item")()) : py::reinterpret_borrow<py::object>(given);
  if (py::isinstance<py::bool_>(value)) return value.cast<bool>() ? "true" : "false";
  const bool number = !std::holds_alternative<std::string Parameters::*>(row.field) &&
                      !std::holds_alternative<bool Parameters::*>(row.field);
  return py::str(number ? py::repr(value) : py::str(value)).cast<std::string>();
}

std::map<std::string, Parameters> readPresets() {
  std::map<std::string, Parameters> all;
  for (const auto& entry : tools::presets()) tools::readPreset(entry.first, all[entry.first]);
  return all;
}

/// Returns the parameters of a preset. Throws std::invalid_argument for an unknown name.
Parameters presetNamed(const std::string& name) {
  // Reads the presets only once, because reading the YAML takes 2 % as long as matching two images.
  static const std::map<std::string, Parameters> all = readPresets();
  const auto found = all.find(name);
  if (found != all.end()) return found->second;
  Parameters unknown;
  tools::readPreset(name, unknown);
  return unknown;
}

}  // namespace

Parameters parametersFrom(const Settings& settings, Scope scope) {
  Parameters parameters = presetNamed(py::str(settings.preset));
  for (const auto& [key, value] : settings.changes) {
    const auto name = key.cast<std::string>();
    const ParameterRow* const row = findParameter(name);
    if (row == nullptr || !obeys(scope, *row)) {
      const std::vector<std::string> names = namesOf(scope);
      throw std::invalid_argument(name + " is not a parameter of this object" +
                                  hintOnName(name, names) +
                                  "; expected one of these (doc/parameters.md describes them): " +
                                  util::joined(names, ", "));
    }
    setParameter(*row, textOf(*row, value), parameters);
  }
  return parameters;
}

}  // namespace ktgp_orb::python
