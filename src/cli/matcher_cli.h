#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "parameters/options.h"

namespace ktgp_orb::tools {

using ktgp_orb::PipelineOptions;

/// Adds an option for each parameter of the nodelet, by its name, with the text, range and default
/// of the table, and --preset and --params. After parsing, `parameters`, which holds the defaults,
/// has the values: the command line counts before the file, the file before the preset. What cannot
/// be used ends parsing with a message that says what is expected.
void addParameterOptions(CLI::App& app, Parameters& parameters);

/// The same for the parameters that decide the outcome for a pair of images.
void addPipelineOptions(CLI::App& app, PipelineOptions& options);

/// The parameters of addPipelineOptions by their names.
nlohmann::json toJson(const PipelineOptions& options);

/// The text of a file; bytes that are not UTF-8, of names of files for example, are replaced.
std::string textOf(const nlohmann::json& json, int indentation);

/// --version, and --force for `force`.
void addCommonOptions(CLI::App& app, bool& force);

/// For an option: refuses what is not a number in the range, NaN for example.
CLI::Validator numberIn(const Limits& range);

/// Parses the command line; returns the code to exit with, or nothing to go on.
/// 0 after --help or --version, 2 for anything that cannot be used.
std::optional<int> parse(CLI::App& app, int argc, char** argv);

}  // namespace ktgp_orb::tools
