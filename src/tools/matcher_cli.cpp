#include "tools/matcher_cli.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "homography/transform.h"
#include "parameters/near_name.h"
#include "tools/parameter_file.h"
#include "util/counted.h"
#include "util/format.h"

namespace ktgp_orb::tools {
namespace {

/// Returns true if the parameter influences the results of a recording. Parameters for the node's
/// services, subscribers and diagnostics do not.
bool decidesARecording(const ParameterRow& row) {
  return row.group != "warnings" && row.name != "lazy";
}

bool decidesAPair(const ParameterRow& row) {
  return decidesARecording(row) && row.group != "stream_images" &&
         row.group != "stream_reference" && row.name.rfind("overlay", 0) != 0 &&
         row.name != "max_rate";
}

double valueOf(double number) {
  return number;
}

nlohmann::json valueOf(const Eigen::Matrix3d& matrix) {
  return toJson(matrix);
}

std::vector<double> valueOf(const Covariance8& matrix) {
  return rowsOf(matrix);
}

/// Throws if a parameter for the images of a stream, such as camera_info or the region of interest,
/// differs from its default. Other parameters of a stream are named and accepted, because they do
/// not influence a match.
void refuseOfStream(const Parameters& parameters) {
  const Parameters usual;
  for (const ParameterRow& row : parameterRows()) {
    if (row.group != "stream_images") continue;
    const std::string value = valueText(row, parameters);
    if (value == valueText(row, usual)) continue;
    throw std::invalid_argument(row.name + " is " + value +
                                ", which is for the images of a node or a recording; expected "
                                "parameters without it, or ktgp_bag");
  }
}

bool isFlag(const ParameterRow& row) {
  return std::holds_alternative<bool Parameters::*>(row.field);
}

/// The type of the option's value, which --help shows after the option, such as "TEXT".
std::string typeName(const ParameterRow& row) {
  if (!row.choices.empty()) return util::joined(row.choices, "|");
  if (std::holds_alternative<std::string Parameters::*>(row.field)) return "TEXT";
  const bool whole = std::holds_alternative<int Parameters::*>(row.field);
  return (whole ? "INT in " : "NUMBER in ") + row.limits.text();
}

std::string textOf(const ParameterInfo& info) {
  return info.unit.empty() ? info.text : info.text + " [" + info.unit + "]";
}

/// The values that the user gave on the command line. The key is the name of a parameter, or
/// "preset" or "params" for these two options.
using Given = std::map<std::string, std::string>;

void addOption(CLI::App& app, const ParameterRow& row, const Parameters& defaults,
               const std::shared_ptr<Given>& given) {
  const std::string option = "--" + row.name;
  const std::string text = textOf(row);
  const auto take = [given, &row](const std::string& value) {
    try {
      Parameters checked;
      setParameter(row, value, checked);
    } catch (const std::invalid_argument& error) {
      throw CLI::ValidationError("--" + row.name, error.what());
    }
    (*given)[row.name] = value;
  };
  CLI::Option* added = nullptr;
  if (isFlag(row)) {
    added = app.add_flag(option, text)->each(take);
  } else {
    added = app.add_option_function<std::string>(option, take, text)->type_name(typeName(row));
  }
  added->default_str(valueText(row, defaults))->group("Parameters: " + row.group);
}

/// Names the given parameters that the program does not use: a file of a node has all parameters,
/// and a mistake would not be seen. A preset may have such parameters, too, but nobody chose them.
void nameIdle(const Given& given, const Parameters& of_file, const Parameters& parameters,
              const IsIdle& is_idle) {
  const Parameters usual;
  std::vector<std::string> names;
  for (const ParameterRow& row : parameterRows()) {
    const bool is_given =
        given.count(row.name) > 0 || valueText(row, of_file) != valueText(row, usual);
    if (is_given && is_idle(row, parameters)) names.push_back(row.name);
  }
  if (names.empty()) return;
  std::fprintf(stderr, "without effect in this run: %s\n", util::joined(names, ", ").c_str());
}

/// Returns the values of the parameters: those of the preset, those of the file of --params
/// instead, and those of the options instead. `preset`: used if the command line names neither a
/// preset nor a file. Sets `of_file` to the values of the file alone.
Parameters valuesOf(const Given& given, const std::string& preset, const Parameters& defaults,
                    Parameters& of_file) {
  Parameters parameters = defaults;
  const std::string& file = given.at("params");
  const std::string& chosen = given.at("preset");
  const std::string& first = chosen.empty() && file.empty() ? preset : chosen;
  if (!first.empty()) readPreset(first, parameters);
  if (!file.empty()) {
    const std::string text = parameterText(file);
    readParameters(file, text, parameters);
    readParameters(file, text, of_file);
  }
  for (const auto& [name, text] : given) {
    const ParameterRow* const row = findParameter(name);
    if (row != nullptr) setParameter(*row, text, parameters);
  }
  return parameters;
}

/// Adds an option for each parameter that `wanted` accepts. After parsing, calls `done` with the
/// values of the parameters, and then names the ones without effect.
void addOptions(CLI::App& app, bool (*wanted)(const ParameterRow&), const Parameters& defaults,
                const std::string& preset, const IsIdle& is_idle,
                const std::function<void(const Parameters&)>& done) {
  const auto given = std::make_shared<Given>();
  Parameters shown = defaults;
  if (!preset.empty()) readPreset(preset, shown);
  const char* const group = "Parameters";
  app.add_option("--preset", (*given)["preset"], "preset to start from: " + namesOfPresets())
      ->type_name("NAME")
      ->default_str(preset)
      ->group(group);
  app.add_option("--params", (*given)["params"],
                 "YAML file of parameters, as `rosparam dump` and `dynparam dump` write it")
      ->type_name("FILE")
      ->group(group);
  for (const ParameterRow& row : parameterRows()) {
    if (wanted(row)) addOption(app, row, shown, given);
  }
  const auto is_unused = [wanted, is_idle](const ParameterRow& row, const Parameters& all) {
    // Mode fixed chooses other options, also for a pair; see noteOnFixed().
    if (row.name == "reference_mode" && all.reference_mode == "fixed") return false;
    return !wanted(row) || is_idle(row, all);
  };
  app.callback([given, preset, defaults, done, is_unused] {
    try {
      Parameters of_file;
      const Parameters parameters = valuesOf(*given, preset, defaults, of_file);
      const std::string note = noteOnFixed(parameters);
      if (!note.empty()) std::fprintf(stderr, "%s\n", note.c_str());
      done(parameters);
      nameIdle(*given, of_file, parameters, is_unused);
    } catch (const std::invalid_argument& error) {
      throw CLI::ValidationError(error.what());
    }
  });
}

/// Joins arguments that CLI11 would not understand: a flag with its value after a blank, as in
/// "--gms_rotation true", and an option with an empty value, as in "--motion_base_frame=".
std::vector<std::string> completed(int argc, char** argv) {
  std::vector<std::string> joined;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const bool value = word == "true" || word == "false";
    const std::string before = joined.empty() ? "" : joined.back();
    const ParameterRow* row =
        before.rfind("--", 0) == 0 ? findParameter(before.substr(2)) : nullptr;
    if (value && row != nullptr && isFlag(*row)) {
      joined.back() += "=" + word;
    } else if (word.rfind("--", 0) == 0 && word.back() == '=') {
      joined.insert(joined.end(), {word.substr(0, word.size() - 1), ""});
    } else {
      joined.push_back(word);
    }
  }
  return joined;
}

nlohmann::json valueOf(const ParameterRow& row, const Parameters& parameters) {
  return std::visit([&](auto field) { return nlohmann::json(parameters.*field); }, row.field);
}

/// The name of an option as users write it. Is taken from get_lnames(), because get_name() is empty
/// for options that --help does not show.
std::string nameOf(const CLI::Option& option) {
  const std::vector<std::string>& names = option.get_lnames();
  return names.empty() ? option.get_name() : "--" + names.front();
}

/// Says which words of the command line nothing takes: options, or else more names than expected.
std::string whatIsTooMuch(const CLI::App& app, const std::string& on_many_names) {
  std::vector<std::string> words = app.remaining();
  words.erase(std::remove(words.begin(), words.end(), "--"), words.end());  // the mark before names
  const auto option = std::find_if(words.begin(), words.end(), [](const std::string& word) {
    return word.size() > 1 && word.front() == '-';
  });
  std::vector<std::string> options;
  std::vector<std::string> expected;
  std::size_t names = words.size();
  for (const CLI::Option* const each : app.get_options()) {
    for (const std::string& name : each->get_lnames()) options.push_back("--" + name);
    if (!each->get_positional()) continue;
    expected.push_back(each->get_name(true));
    names += each->count();
  }
  if (option != words.end()) {
    const std::string name = option->substr(0, option->find('='));
    return "This option was not expected: " + name + hintOnName(name, options);
  }
  return "expected " + (expected.empty() ? "only options" : util::joined(expected, " and ")) +
         ", but " + util::counted(names, "name") + " came" +
         (on_many_names.empty() ? "" : "; " + on_many_names);
}

}  // namespace

void addParameterOptions(CLI::App& app, Parameters& parameters, const IsIdle& is_idle) {
  addOptions(app, decidesARecording, parameters, "", is_idle,
             [&](const Parameters& given) { parameters = given; });
}

void addPipelineOptions(CLI::App& app, PipelineOptions& options, const IsIdle& is_idle,
                        const std::string& preset) {
  const auto take = [&](const Parameters& parameters) {
    refuseOfStream(parameters);
    options = pipelineOptions(parameters);
    const OrbExtractor checked_extractor(options.orb);
    const KtgpMatcher checked_matcher(options.matcher);
  };
  addOptions(app, decidesAPair, options.parameters, preset, is_idle, take);
}

nlohmann::json toJson(const Eigen::Matrix3d& m) {
  return {{m(0, 0), m(0, 1), m(0, 2)}, {m(1, 0), m(1, 1), m(1, 2)}, {m(2, 0), m(2, 1), m(2, 2)}};
}

nlohmann::json toJson(const UncertainHomography& answer) {
  nlohmann::json out;
  homography::visitAnswer([&](const char* name, const auto& value) { out[name] = valueOf(value); },
                          answer);
  return out;
}

nlohmann::json toJson(const PipelineOptions& options) {
  nlohmann::json out;
  for (const ParameterRow& row : parameterRows()) {
    if (decidesAPair(row)) out[row.name] = valueOf(row, options.parameters);
  }
  return out;
}

std::string textOf(const nlohmann::json& json, int indentation) {
  return json.dump(indentation, ' ', false, nlohmann::json::error_handler_t::replace) + '\n';
}

void addCommonOptions(CLI::App& app, bool& force) {
  app.add_flag("--force", force, "overwrite existing output files");
  app.add_flag_callback(
      "--version",
      [] {
        std::puts("ktgp_orb " KTGP_ORB_VERSION);
        throw CLI::Success();
      },
      "print the version and exit");
}

CLI::Option* addCameraOption(CLI::App& app, const std::string& name, std::vector<double>& camera,
                             const std::string& text) {
  const auto read = [&camera, name](const std::string& given) {
    const std::vector<std::string> numbers = CLI::detail::split(given, ',');
    camera.resize(numbers.size());
    bool is_camera = numbers.size() == 4;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      is_camera = CLI::detail::lexical_cast(numbers[i], camera[i]) && is_camera;
    }
    if (!is_camera) throw CLI::ValidationError(name, given + " is no camera; expected fx,fy,cx,cy");
  };
  return app.add_option_function<std::string>(name, read, text)->type_name("fx,fy,cx,cy");
}

std::optional<Eigen::Matrix3d> cameraFrom(const std::vector<double>& camera) {
  if (camera.empty()) return std::nullopt;
  Eigen::Matrix3d k;
  k << camera[0], 0.0, camera[2], 0.0, camera[1], camera[3], 0.0, 0.0, 1.0;
  return k;
}

CLI::Validator numberIn(const Limits& range) {
  const auto check = [range](const std::string& text) -> std::string {
    double number = 0.0;
    if (!CLI::detail::lexical_cast(text, number)) return text + " is not a number";
    if (range.contains(number)) return {};
    return text + " is out of range; expected a number in " + range.text();
  };
  return CLI::Validator(check, "in " + range.text());
}

CLI::Validator wholeNumberIn(int low, int high) {
  const Limits range(low, high);
  const auto check = [range](const std::string& text) -> std::string {
    double number = 0.0;
    int whole = 0;
    if (!CLI::detail::lexical_cast(text, number)) return text + " is not a number";
    if (!range.contains(number)) {
      return text + " is out of range; expected a whole number in " + range.text();
    }
    return CLI::detail::lexical_cast(text, whole) ? "" : text + " is not a whole number";
  };
  return CLI::Validator(check, "in " + range.text());
}

CLI::Option* describe(CLI::Option* option, const std::string& nodelet) {
  const std::string& name = option->get_lnames().front();
  const ParameterInfo& info = parameterOf(nodelet, name.substr(name.find('_') + 1));
  if (!info.limits.text().empty()) option->check(numberIn(info.limits));
  if (!info.choices.empty()) option->check(CLI::IsMember(info.choices));
  return option->description(textOf(info));
}

/// Hides the many options for the stages and the stream from --help, because few users need them.
void hideRareOptions(CLI::App& app) {
  std::size_t hidden = 0;
  for (CLI::Option* const option : app.get_options([](const CLI::Option* each) {
         const std::string& group = each->get_group();
         return group.rfind("Parameters: ", 0) == 0 && group != "Parameters: method";
       })) {
    option->group("");
    ++hidden;
  }
  if (hidden == 0) return;
  app.footer("--help-all also describes " + std::to_string(hidden) +
             " parameters (doc/parameters.md).\n\n" + app.get_footer());
}

/// Refuses an empty name of a file or preset, which would count as not given.
void refuseEmptyNames(const CLI::App& app) {
  for (const CLI::Option* const option : app.get_options()) {
    const bool is_preset = option->check_lname("preset");
    const bool is_file = option->get_positional() || option->get_type_name().rfind("FILE", 0) == 0;
    const std::vector<std::string>& values = option->results();
    if ((!is_preset && !is_file) || std::count(values.begin(), values.end(), "") == 0) continue;
    throw CLI::ValidationError(nameOf(*option) + " is empty; expected a " +
                               (is_preset ? "name" : "file"));
  }
}

std::optional<int> parse(CLI::App& app, int argc, char** argv, const std::string& on_many_names) {
  app.name(std::filesystem::path(argv[0]).filename().string());
  app.set_help_flag("-h,--help,--help-all",
                    "print this help, or the help for all options, and exit");
  const bool shows_all = std::any_of(
      argv, argv + argc, [](const char* word) { return std::string("--help-all") == word; });
  if (!shows_all) hideRareOptions(app);
  try {
    std::vector<std::string> words = completed(argc, argv);
    std::reverse(words.begin(), words.end());  // CLI11 expects the reversed order
    app.parse(std::move(words));
    refuseEmptyNames(app);
  } catch (const CLI::ExtrasError& error) {
    return app.exit(CLI::Error(error.get_name(), whatIsTooMuch(app, on_many_names))) == 0 ? 0 : 2;
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return std::nullopt;
}

files::OutputPlan planOutputs(const CLI::App& app, bool force) {
  files::OutputPlan::Given given;
  for (const CLI::Option* const option : app.get_options()) {
    for (const std::string& value : option->results()) given.push_back({nameOf(*option), value});
  }
  return {force, std::move(given)};
}

}  // namespace ktgp_orb::tools
