#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <optional>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb::tools {

/// Everything that decides the outcome for a pair of images.
struct PipelineOptions {
  OrbOptions orb;
  MatcherOptions matcher;
};

/// Adds every threshold of the extractor and of the four stages to `app`, each with its default
/// and range. A value outside its range ends parsing with a message that says the range.
void addPipelineOptions(CLI::App& app, PipelineOptions& options);

/// The options by the names they have on the command line, without the dashes.
nlohmann::json toJson(const PipelineOptions& options);

/// Parses the command line; returns the code to exit with, or nothing to go on.
/// 0 after --help, 2 for anything that cannot be used.
std::optional<int> parse(CLI::App& app, int argc, char** argv);

}  // namespace ktgp_orb::tools
