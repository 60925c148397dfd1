#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "evaluation/pair_evaluation.h"

namespace ktgp_orb::evaluation {

/// Quality of the homographies of one method over the pairs of one set.
struct AccuracySummary {
  /// Area under the curve of the corner error up to each of kAucThresholds.
  std::array<double, kAucThresholds.size()> auc{};
  double median_corner_error = 0.0;  ///< px; infinite if half of the pairs have no homography
  double found = 0.0;                ///< share of pairs with a homography that the method accepts
  double wrong = 0.0;          ///< share of the found homographies with an error above kWrongBeyond
  std::optional<double> zncc;  ///< mean over the pairs with a homography; needs no ground truth
  // Over the pairs whose homography has a covariance; see CornerConsistency.
  std::optional<double> consistency_ratio;   ///< median of the true over the predicted corner error
  std::optional<double> consistency_median;  ///< median of e' S^-1 e at the corners
  std::optional<double> consistent;          ///< share of corners below kConsistentBelow
};

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
  // Means of the pairs' means and RMS, as in the paper; pairs without a match do not count.
  metrics::ErrorSummary descriptor_distance;
  metrics::ErrorSummary displacement;
  metrics::ErrorSummary reprojection_error;
  double total_milliseconds = 0.0;          ///< from the images to the result
  std::optional<AccuracySummary> accuracy;  ///< only if the method estimates a homography
};

/// One entry per set and method, in the order of `scores`, then "all" if there are several sets.
std::vector<SetSummary> summarizeSets(const std::vector<PairScore>& scores);

/// All data: a row per pair and method, and the summary. Infinite values become null.
nlohmann::json toJson(const std::vector<PairScore>& scores);

/// One row per pair and method.
std::string toCsv(const std::vector<PairScore>& scores);

/// A table for the terminal.
std::string toTable(const std::vector<SetSummary>& summaries);

}  // namespace ktgp_orb::evaluation
