#pragma once

#include <string>
#include <vector>

#include "evaluation/method_steps.h"
#include "parameters/options.h"

namespace ktgp_orb::evaluation {

struct Method {
  std::string name;
  std::string description;
  std::vector<Step> steps;
  std::string unavailable{};  ///< why this build cannot run it; empty if it can
};

/// All methods with our features and the thresholds of `options`. If `estimator` is not empty,
/// every method that estimates a homography uses it, except the presets, which are the unchanged
/// matcher. doc/evaluation.md describes our choices for gaps in the literature.
std::vector<Method> allMethods(const PipelineOptions& options, const std::string& estimator = "");

/// Time and result of one step.
struct StepResult {
  std::string name;
  std::size_t matches = 0;  ///< matches left after the step
  double milliseconds = 0.0;
};

Matching runMethod(const Method& method, const Scene& scene, std::vector<StepResult>& steps);

}  // namespace ktgp_orb::evaluation
