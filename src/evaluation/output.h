#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "evaluation/pair_evaluation.h"

namespace ktgp_orb::tools {

/// Averages of one method over the pairs of one set.
struct SetSummary {
  std::string set;  ///< "all" for all sets together
  std::string method;
  std::size_t pairs = 0;
  double matches = 0.0;
  double retention = 0.0;
  double matched_share = 0.0;
  double detector_repeatability = 0.0;
  double correct = 0.0;
  double extraction_milliseconds = 0.0;
  double milliseconds = 0.0;
  std::array<double, kPrecisionThresholds.size()> precision{};
  // Averages of the pairs' means and RMS, as in the paper; pairs without a match do not count.
  ErrorSummary descriptor_distance;
  ErrorSummary displacement;
  ErrorSummary reprojection_error;
  /// Of the corner error; only where the method estimates a homography.
  std::optional<std::array<double, kAucThresholds.size()>> auc;
};

/// One entry per set and method, in the order of `scores`, then "all" where there are several sets.
std::vector<SetSummary> summarizeSets(const std::vector<PairScore>& scores);

/// Everything: a row per pair and method, and the summary. Infinite values become null.
nlohmann::json toJson(const std::vector<PairScore>& scores);

/// One row per pair and method.
std::string toCsv(const std::vector<PairScore>& scores);

/// For the terminal.
std::string toTable(const std::vector<SetSummary>& summaries);

}  // namespace ktgp_orb::tools
