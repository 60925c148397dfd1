#include "tools/parameter_file.h"

#include <yaml-cpp/yaml.h>

#include <fstream>
#include <set>
#include <stdexcept>
#include <vector>

#include "parameters/near_name.h"
#include "util/format.h"

namespace ktgp_orb::tools {
namespace {

/// Throws std::invalid_argument if a name occurs twice, because YAML parsers do not agree on which
/// of the two values counts.
void requireEachOnce(const YAML::Node& map) {
  std::set<std::string> names;
  for (const auto& entry : map) {
    if (!entry.first.IsScalar() || names.insert(entry.first.Scalar()).second) continue;
    throw std::invalid_argument(entry.first.Scalar() + " occurs twice; expected it once");
  }
}

YAML::Node onlyDocument(const std::string& text) {
  const std::vector<YAML::Node> documents = YAML::LoadAll(text);
  if (documents.size() > 1) {
    throw std::invalid_argument("has " + std::to_string(documents.size()) +
                                " YAML documents; expected one");
  }
  return documents.empty() ? YAML::Node() : documents.front();
}

/// Finds the map that contains the parameters. It may be nested in other maps.
YAML::Node parametersIn(YAML::Node node) {
  constexpr int kDeepest = 16;  // limit of the nesting: a map may contain itself
  for (int depth = 0; node.IsMap(); ++depth) {
    if (depth > kDeepest) {
      throw std::invalid_argument(
          "it is nested too deeply; expected `name: value` lines in one or two");
    }
    requireEachOnce(node);
    if (node["dictitems"]) {  // dynparam dump writes a Python object
      node.reset(node["dictitems"]);
      // The only entry is a namespace that contains the parameters.
    } else if (node.size() == 1 && node.begin()->second.IsMap()) {
      node.reset(YAML::Node(node.begin()->second));
    } else {
      break;
    }
  }
  return node;
}

std::vector<std::string> namesOfParameters() {
  std::vector<std::string> names;
  for (const ParameterRow& row : parameterRows()) names.push_back(row.name);
  return names;
}

/// Throws std::invalid_argument for an argument of the launch files that is no parameter of the
/// node: in a file of parameters, nothing would read it.
void refuseArgument(const std::string& name, const YAML::Node& value) {
  if (name != "preset" && name != "params") return;
  throw std::invalid_argument(name + " is an argument, not a parameter; expected --" + name +
                              (value.IsScalar() ? " " + value.Scalar() : ""));
}

void readYaml(const std::string& text, Parameters& parameters) {
  // `rosparam dump` of a node also writes these. They do not change the results, so skip them.
  static const std::set<std::string> of_input{"image_transport", "queue_size", "reference_was_set"};
  const YAML::Node all = parametersIn(onlyDocument(text));
  // An empty map is what `rosparam dump` writes of a node with a misspelt name.
  if (!all.IsMap() || all.size() == 0) {
    throw std::invalid_argument("sets no parameter; expected a line `name: value` for each");
  }
  std::vector<std::string> maps;
  bool sets_a_parameter = false;
  for (const auto& entry : all) {
    const auto name = entry.first.as<std::string>();
    // A map is a group of dynamic_reconfigure or holds the parameters of a plugin: skip it, too.
    if (entry.second.IsMap()) maps.push_back(name);
    if (entry.second.IsMap() || of_input.count(name) > 0) continue;
    refuseArgument(name, entry.second);
    if (entry.second.IsNull()) throw std::invalid_argument(name + " is empty; expected a value");
    const ParameterRow* row = findParameter(name);
    if (row == nullptr) {
      throw std::invalid_argument("there is no parameter " + name +
                                  hintOnName(name, namesOfParameters()));
    }
    if (!entry.second.IsScalar()) throw std::invalid_argument(name + " is not a single value");
    const bool quoted = entry.second.Tag() == "!";
    if (quoted && !std::holds_alternative<std::string Parameters::*>(row->field)) {
      throw std::invalid_argument(name + " is the text '" + entry.second.Scalar() +
                                  "'; expected it without quotes");
    }
    setParameter(*row, entry.second.Scalar(), parameters);
    sets_a_parameter = true;
  }
  if (!sets_a_parameter && !maps.empty()) {
    throw std::invalid_argument("holds the parameters of " + util::joined(maps, " and of ") +
                                "; expected those of one node alone, as `rosparam dump FILE "
                                "/camera/matcher` writes them");
  }
}

}  // namespace

std::string parameterText(const std::string& file) {
  constexpr std::size_t kMost = 1 << 20;  // size limit, bytes: a device file may be endless
  std::ifstream in(file);
  std::string text(kMost + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (in.bad() || (in.fail() && !in.eof())) throw std::invalid_argument(file + ": cannot be read");
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > kMost) {
    throw std::invalid_argument(file + ": is longer than 1 MB; expected a file of parameters");
  }
  return text;
}

void readParameters(const std::string& name, const std::string& text, Parameters& parameters) {
  try {
    readYaml(text, parameters);
  } catch (const YAML::Exception& error) {
    throw std::invalid_argument(name + ": " + error.what());
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(name + ": " + error.what());
  }
}

void readPreset(const std::string& name, Parameters& parameters) {
  const auto preset = presets().find(name);
  if (preset == presets().end()) {
    throw std::invalid_argument("preset is " + name + "; expected " + namesOfPresets());
  }
  readParameters("preset " + name, preset->second, parameters);
}

std::string namesOfPresets() {
  std::string names;
  for (const auto& preset : presets()) names += (names.empty() ? "" : ", ") + preset.first;
  return names;
}

}  // namespace ktgp_orb::tools
