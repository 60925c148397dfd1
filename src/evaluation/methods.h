#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/matcher_cli.h"
#include "evaluation/method_steps.h"

namespace ktgp_orb::tools {

/// A named sequence of steps.
struct Method {
  std::string name;
  std::string description;
  std::vector<Step> steps;
  std::string unavailable{};  ///< why it cannot be run in this build; empty where it can
};

/// All methods over our features, with the thresholds of `options`. With `estimator`, every method
/// that ends in a homography uses that one, but for the presets, which are the matcher as it is.
/// What the literature leaves open is said in doc/method.md.
std::vector<Method> allMethods(const PipelineOptions& options,
                               std::optional<Estimator> estimator = std::nullopt);

/// Time and result of one step.
struct StepResult {
  std::string name;
  std::size_t matches = 0;  ///< left after it
  double milliseconds = 0.0;
};

/// Runs the method's steps one after the other.
Matching runMethod(const Method& method, const Scene& scene, std::vector<StepResult>& steps);

}  // namespace ktgp_orb::tools
