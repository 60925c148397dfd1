#include "python/options.h"

#include <map>
#include <set>
#include <stdexcept>

#include "cli/parameter_file.h"
#include "cli/presets.h"
#include "parameters/options.h"

namespace ktgp_orb::python {
namespace {

namespace py = pybind11;

bool obeys(Scope scope, const ParameterRow& row) {
  static const std::set<std::string> of_sequence{"reference_mode",       "keyframe_min_overlap",
                                                 "keyframe_min_inliers", "max_reference_age",
                                                 "search_radius",        "views"};
  if (of_sequence.count(row.name) != 0) return scope == Scope::sequence;
  return row.name == "threads" || row.group == "method" || row.group.rfind("stage_", 0) == 0;
}

std::string textOf(const ParameterRow& row, const py::handle& given) {
  // A scalar of NumPy, as the number that it is.
  const bool is_scalar = py::hasattr(given, "dtype") && py::hasattr(given, "item");
  const auto value =
      is_scalar ? py::object(given.attr("item")()) : py::reinterpret_borrow<py::object>(given);
  if (py::isinstance<py::bool_>(value)) return value.cast<bool>() ? "true" : "false";
  const bool number = !std::holds_alternative<std::string Parameters::*>(row.field) &&
                      !std::holds_alternative<bool Parameters::*>(row.field);
  return py::str(number ? py::repr(value) : py::str(value)).cast<std::string>();
}

struct Preset {
  Parameters parameters;
  std::set<std::string> names;  ///< of the parameters that it sets
};

std::map<std::string, Preset> readPresets() {
  std::map<std::string, Preset> all;
  for (const auto& entry : tools::presets()) {
    Preset& preset = all[entry.first];
    preset.names = tools::readPreset(entry.first, preset.parameters);
  }
  return all;
}

/// Throws std::invalid_argument for an unknown name.
Preset presetNamed(const std::string& name) {
  // Once: reading YAML takes as long as 2 % of matching two images.
  static const std::map<std::string, Preset> all = readPresets();
  const auto found = all.find(name);
  if (found != all.end()) return found->second;
  Preset unknown;
  unknown.names = tools::readPreset(name, unknown.parameters);
  return unknown;
}

}  // namespace

Parameters parametersFrom(const Settings& settings, Scope scope) {
  const std::string usual = Parameters().descriptor;
  auto [parameters, names] = presetNamed(py::str(settings.preset));
  for (const auto& [key, value] : settings.changes) {
    const auto name = key.cast<std::string>();
    const ParameterRow* const row = findParameter(name);
    if (row == nullptr || !obeys(scope, *row)) {
      throw std::invalid_argument(name +
                                  " is not a parameter of this object; doc/parameters.md lists "
                                  "them: method, stage_1 to stage_7, threads" +
                                  (scope == Scope::sequence ? ", and those of the reference" : ""));
    }
    setParameter(*row, textOf(*row, value), parameters);
    names.insert(name);
  }
  if (names.count("T_w") == 0) {
    parameters.T_w = followDescriptor(parameters.T_w, usual, parameters.descriptor);
  }
  return parameters;
}

}  // namespace ktgp_orb::python
