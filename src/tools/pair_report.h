#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ktgp_orb/metrics.h"
#include "ktgp_orb/pair_matcher.h"
#include "parameters/options.h"

namespace ktgp_orb::tools {

/// The results of ktgp_match for two images.
struct Outcome {
  std::string reference_file;
  std::string target_file;
  PairMatch pair;
  MatchHints hints;
  // Statistics of the matches that remain after each of the four stages.
  std::array<metrics::ErrorSummary, 4> distances;  ///< descriptor distances
  /// Errors of the matches with respect to `truth`, px; empty if the true homography is unknown.
  std::array<std::vector<double>, 4> errors;
  std::vector<double> guided_errors;  ///< the same for the guided matches
  std::optional<Eigen::Matrix3d> truth;
};

/// The scene points, triangulated from the final matches; empty if no motion was found.
std::vector<ScenePoint> pointsOf(const Outcome& outcome);

void print(const Outcome& outcome, const PipelineOptions& options);
nlohmann::json toJson(const Outcome& outcome, const PipelineOptions& options);

}  // namespace ktgp_orb::tools
