#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "files/output_file.h"
#include "parameters/options.h"

namespace ktgp_orb::tools {

using ktgp_orb::PipelineOptions;

/// Returns true if the program does not use the parameter. `all`: all values of the user.
using IsIdle = std::function<bool(const ParameterRow& row, const Parameters& all)>;

/// Adds --preset, --params and an option for each parameter of the nodelet that influences the
/// results of a recording. The parameter table gives the name, text, range and default of the
/// option. Before parsing, `parameters` must hold the default values; after parsing, it holds the
/// values of the user. Options override the file of --params, and the file overrides the preset. An
/// unusable value ends parsing with a message that says what is expected. A line on the standard
/// error names the given parameters without effect: those without an option, since they are for
/// the node alone, and those that `is_idle` names, which is called after parsing.
void addParameterOptions(CLI::App& app, Parameters& parameters, const IsIdle& is_idle);

/// Adds options for the parameters that determine the result for a pair of images. `preset`: name
/// of the preset that is used if the command line has neither --preset nor --params; empty: no
/// preset. Names parameters without effect like addParameterOptions().
void addPipelineOptions(CLI::App& app, PipelineOptions& options, const IsIdle& is_idle,
                        const std::string& preset = "");

/// JSON object with the names and values of the parameters that addPipelineOptions() adds.
nlohmann::json toJson(const PipelineOptions& options);

/// The matrix as a JSON array of three rows.
nlohmann::json toJson(const Eigen::Matrix3d& matrix);
/// All numbers of the matrix, row by row.
template <int Size, int Options>
std::vector<double> rowsOf(const Eigen::Matrix<double, Size, Size, Options>& matrix) {
  const Eigen::Matrix<double, Size, Size, Eigen::RowMajor> rows = matrix;
  return {rows.data(), rows.data() + rows.size()};
}
/// JSON object with the names and values of the fields of `answer`.
nlohmann::json toJson(const UncertainHomography& answer);

/// The text of a JSON document. Bytes that are not UTF-8, for example in a file name, are replaced.
std::string textOf(const nlohmann::json& json, int indentation);

/// Adds the options --version and --force; --force sets `force`.
void addCommonOptions(CLI::App& app, bool& force);

/// Adds an option with four values fx,fy,cx,cy, px: the camera matrix K of an image without
/// distortion.
CLI::Option* addCameraOption(CLI::App& app, const std::string& name, std::vector<double>& camera,
                             const std::string& text);
/// The matrix K from the four values of addCameraOption(); empty if the option was not given.
std::optional<Eigen::Matrix3d> cameraFrom(const std::vector<double>& camera);

/// Refuses a value that is not a number, is NaN, or lies outside the range.
CLI::Validator numberIn(const Limits& range);

/// Refuses a value that is not a whole number, or that lies outside the range.
CLI::Validator wholeNumberIn(int low, int high);

/// Describes an option with the text, unit, range and choices of a parameter of `nodelet`. The
/// option "--X_name" belongs to the parameter "name". Throws std::invalid_argument like
/// parameterOf.
CLI::Option* describe(CLI::Option* option, const std::string& nodelet);

/// Parses the command line. Returns nothing if the program should continue, otherwise the exit
/// code: 0 after --help or --version, 2 if the command line is unusable, for example if the name of
/// a file is empty, as a variable of a script that is not set makes it. `on_many_names`: what may
/// be the cause of more names of files than the program takes; empty: nothing to add.
std::optional<int> parse(CLI::App& app, int argc, char** argv,
                         const std::string& on_many_names = "");

/// Makes the plan of input and output files from all values of the command line. Call this after
/// parse().
files::OutputPlan planOutputs(const CLI::App& app, bool force);

}  // namespace ktgp_orb::tools
