#include "evaluation/output.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "files/csv.h"
#include "ktgp_orb/metrics.h"
#include "util/format.h"

namespace ktgp_orb::evaluation {
namespace {

using nlohmann::json;
using util::format;

/// Means over the pairs that have the value.
metrics::ErrorSummary averageOf(const std::vector<const MethodScore*>& scores,
                                metrics::ErrorSummary MethodScore::*value) {
  metrics::ErrorSummary average;
  for (const MethodScore* m : scores) {
    const metrics::ErrorSummary& summary = m->*value;
    if (summary.count == 0) continue;
    average.mean += summary.mean;
    average.rms += summary.rms;
    ++average.count;
  }
  const auto n = static_cast<double>(std::max<std::size_t>(average.count, 1));
  return {average.count, average.mean / n, average.rms / n};
}

/// Empty if no pair has a corner error, because the method estimates no homography.
std::optional<AccuracySummary> summarizeAccuracy(const std::vector<const MethodScore*>& scores) {
  std::vector<double> errors;
  std::vector<double> correlations;
  std::vector<double> ratios;
  std::vector<double> normalised;
  double found = 0.0;
  double wrong = 0.0;
  for (const MethodScore* m : scores) {
    if (!m->corner_error) continue;
    errors.push_back(*m->corner_error);
    if (m->zncc) correlations.push_back(*m->zncc);
    if (m->consistency) {
      ratios.push_back(m->consistency->ratio);
      const auto& corners = m->consistency->normalised;
      normalised.insert(normalised.end(), corners.begin(), corners.end());
    }
    if (!m->found) continue;
    ++found;
    if (*m->corner_error > kWrongBeyond) ++wrong;
  }
  if (errors.empty()) return std::nullopt;
  AccuracySummary s;
  for (std::size_t i = 0; i < kAucThresholds.size(); ++i) {
    s.auc[i] = metrics::areaUnderCurve(errors, kAucThresholds[i]);
  }
  s.median_corner_error = metrics::median(errors);
  s.found = found / static_cast<double>(errors.size());
  s.wrong = found > 0.0 ? wrong / found : 0.0;
  if (!ratios.empty()) {
    s.consistency_ratio = metrics::median(ratios);
    s.consistency_median = metrics::median(normalised);
    const auto below = [](double value) { return value < kConsistentBelow; };
    s.consistent = static_cast<double>(std::count_if(normalised.begin(), normalised.end(), below)) /
                   static_cast<double>(normalised.size());
  }
  if (!correlations.empty()) s.zncc = metrics::summarize(correlations).mean;
  return s;
}

SetSummary summarizeMethod(const std::string& set, std::size_t method,
                           const std::vector<const PairScore*>& scores) {
  SetSummary s;
  s.set = set;
  s.pairs = scores.size();
  const auto n = static_cast<double>(scores.size());
  std::vector<const MethodScore*> members;
  for (const PairScore* pair : scores) {
    const MethodScore& m = pair->methods[method];
    s.method = m.method;
    s.matches += static_cast<double>(m.matches) / n;
    s.retention += m.retention / n;
    s.matched_share += m.matched_share / n;
    s.detector_repeatability += pair->detector_repeatability / n;
    s.correct += static_cast<double>(m.correct) / n;
    s.extraction_milliseconds += pair->extraction_milliseconds / n;
    s.milliseconds += m.milliseconds / n;
    s.total_milliseconds += m.total_milliseconds / n;
    for (std::size_t i = 0; i < m.precision.size(); ++i) s.precision[i] += m.precision[i] / n;
    members.push_back(&m);
  }
  s.descriptor_distance = averageOf(members, &MethodScore::descriptor_distance);
  s.displacement = averageOf(members, &MethodScore::displacement);
  s.reprojection_error = averageOf(members, &MethodScore::reprojection_error);
  s.accuracy = summarizeAccuracy(members);
  return s;
}

/// The threshold as text, e.g. "1px", for the keys of JSON and CSV.
std::string px(double threshold) {
  std::ostringstream out;
  out << threshold << "px";
  return out.str();
}

void put(json& out, const std::string& key, const metrics::ErrorSummary& summary) {
  out[key + "_mean"] = summary.count > 0 ? json(summary.mean) : json(nullptr);
  out[key + "_rms"] = summary.count > 0 ? json(summary.rms) : json(nullptr);
}

template <typename Values, typename Thresholds>
void put(json& out, const std::string& key, const Values& values, const Thresholds& thresholds) {
  for (std::size_t i = 0; i < values.size(); ++i) out[key + "_" + px(thresholds[i])] = values[i];
}

json orNull(const std::optional<double>& value) {
  return value ? json(*value) : json(nullptr);
}

void put(json& out, const std::optional<CornerConsistency>& consistency) {
  for (const char* key : {"predicted_corner_error", "corner_error_ratio",
                          "corner_normalised_median", "corners_consistent"}) {
    out[key] = nullptr;
  }
  if (!consistency) return;
  const auto& corners = consistency->normalised;
  out["predicted_corner_error"] = consistency->predicted;
  out["corner_error_ratio"] = consistency->ratio;
  out["corner_normalised_median"] = metrics::median({corners.begin(), corners.end()});
  out["corners_consistent"] =
      std::count_if(corners.begin(), corners.end(), [](double x) { return x < kConsistentBelow; });
}

/// The columns of the CSV file: keys of toRow.
constexpr std::array<const char*, 34> kColumns{"set",
                                               "pair",
                                               "method",
                                               "reference_keypoints",
                                               "target_keypoints",
                                               "detector_repeatability",
                                               "matches",
                                               "retention",
                                               "rep_eq9",
                                               "correct_3px",
                                               "precision_1px",
                                               "precision_2px",
                                               "precision_3px",
                                               "descriptor_distance_mean",
                                               "descriptor_distance_rms",
                                               "displacement_mean",
                                               "displacement_rms",
                                               "reprojection_error_mean",
                                               "reprojection_error_rms",
                                               "homography_sought",
                                               "found",
                                               "corner_error",
                                               "within_covariance",
                                               "zncc",
                                               "predicted_corner_error",
                                               "corner_error_ratio",
                                               "corner_normalised_median",
                                               "corners_consistent",
                                               "extraction_ms",
                                               "ms",
                                               "total_ms",
                                               "steps_matches",
                                               "steps_ms",
                                               "problem"};

/// Text such as "knn=38.20;ratio=0.02", for one field of a CSV row.
template <typename Value>
std::string joined(const std::vector<StepResult>& steps, Value value) {
  std::ostringstream out;
  for (const StepResult& step : steps) {
    out << (out.tellp() > 0 ? ";" : "") << step.name << '=' << value(step);
  }
  return out.str();
}

json toRow(const PairScore& pair, const MethodScore& m) {
  json row{{"set", pair.pair.set},
           {"pair", pair.pair.name},
           {"method", m.method},
           {"problem", m.problem},
           {"reference_keypoints", pair.reference_keypoints},
           {"target_keypoints", pair.target_keypoints},
           {"detector_repeatability", pair.detector_repeatability},
           {"extraction_ms", pair.extraction_milliseconds},
           {"matches", m.matches},
           {"retention", m.retention},
           {"rep_eq9", m.matched_share},
           {"correct_3px", m.correct},
           {"corner_error", orNull(m.corner_error)},
           {"within_covariance", m.within_covariance ? json(*m.within_covariance) : json(nullptr)},
           {"homography_sought", m.corner_error.has_value()},
           {"found", m.found},
           {"zncc", orNull(m.zncc)},
           {"ms", m.milliseconds},
           {"total_ms", m.total_milliseconds},
           {"steps_matches", joined(m.steps, [](const StepResult& s) { return s.matches; })},
           {"steps_ms", joined(m.steps, [](const StepResult& s) { return s.milliseconds; })}};
  put(row, "descriptor_distance", m.descriptor_distance);
  put(row, "displacement", m.displacement);
  put(row, "reprojection_error", m.reprojection_error);
  put(row, "precision", m.precision, kPrecisionThresholds);
  put(row, m.consistency);
  return row;
}

json toJson(const std::vector<StepResult>& steps) {
  json out = json::array();
  for (const StepResult& step : steps) {
    out.push_back({{"name", step.name}, {"matches", step.matches}, {"ms", step.milliseconds}});
  }
  return out;
}

void put(json& out, const AccuracySummary& accuracy) {
  for (std::size_t i = 0; i < kAucThresholds.size(); ++i) {
    std::ostringstream key;
    key << "auc_" << kAucThresholds[i];
    out[key.str()] = accuracy.auc[i];
  }
  out["median_corner_error"] = accuracy.median_corner_error;
  out["found"] = accuracy.found;
  out["wrong"] = accuracy.wrong;
  out["zncc"] = orNull(accuracy.zncc);
  out["corner_error_ratio"] = orNull(accuracy.consistency_ratio);
  out["corner_normalised_median"] = orNull(accuracy.consistency_median);
  out["corners_consistent"] = orNull(accuracy.consistent);
}

json toJson(const SetSummary& s) {
  json out{{"set", s.set},
           {"method", s.method},
           {"pairs", s.pairs},
           {"matches", s.matches},
           {"retention", s.retention},
           {"rep_eq9", s.matched_share},
           {"detector_repeatability", s.detector_repeatability},
           {"correct_3px", s.correct},
           {"extraction_ms", s.extraction_milliseconds},
           {"ms", s.milliseconds},
           {"total_ms", s.total_milliseconds}};
  put(out, "descriptor_distance", s.descriptor_distance);
  put(out, "displacement", s.displacement);
  put(out, "reprojection_error", s.reprojection_error);
  put(out, "precision", s.precision, kPrecisionThresholds);
  if (s.accuracy) put(out, *s.accuracy);
  return out;
}

/// Adds an empty field for null and infinity.
void add(const json& value, files::CsvRow& row) {
  const std::string text = value.is_string() ? value.get<std::string>() : value.dump();
  row.add(value.is_string() || text != "null" ? text : "");
}

/// AUCs and shares in percent, the median in px; dashes for missing values.
std::string toColumns(const std::optional<AccuracySummary>& a) {
  if (!a) {
    return format("%5s %5s %5s %5s %8s %6s %6s %6s %6s %7s %6s", "-", "-", "-", "-", "-", "-", "-",
                  "-", "-", "-", "-");
  }
  std::string out;
  for (double auc : a->auc) out += format("%5.1f ", 100.0 * auc);
  const bool known = std::isfinite(a->median_corner_error);
  out += known ? format("%8.3f ", a->median_corner_error) : format("%8s ", "none");
  out += format("%5.1f%% %5.1f%% ", 100.0 * a->found, 100.0 * a->wrong);
  out += a->zncc ? format("%6.3f ", *a->zncc) : format("%6s ", "-");
  if (!a->consistent) return out + format("%6s %7s %6s", "-", "-", "-");
  return out + format("%6.2f %7.2f %5.1f%%", *a->consistency_ratio, *a->consistency_median,
                      100.0 * *a->consistent);
}

}  // namespace

std::vector<SetSummary> summarizeSets(const std::vector<PairScore>& scores) {
  std::vector<std::string> sets;
  for (const PairScore& score : scores) {
    const bool known = std::find(sets.begin(), sets.end(), score.pair.set) != sets.end();
    if (score.problem.empty() && !known) sets.push_back(score.pair.set);
  }
  const bool several = sets.size() > 1;
  if (several) sets.emplace_back("all");

  std::vector<SetSummary> summaries;
  for (std::size_t i = 0; i < sets.size(); ++i) {
    const bool all = several && i + 1 == sets.size();
    std::vector<const PairScore*> members;
    for (const PairScore& score : scores) {
      if (score.problem.empty() && (all || score.pair.set == sets[i])) members.push_back(&score);
    }
    for (std::size_t m = 0; m < members.front()->methods.size(); ++m) {
      summaries.push_back(summarizeMethod(sets[i], m, members));
    }
  }
  return summaries;
}

json toJson(const std::vector<PairScore>& scores) {
  json out{{"results", json::array()}, {"summary", json::array()}};
  for (const PairScore& pair : scores) {
    for (const MethodScore& method : pair.methods) {
      json row = toRow(pair, method);
      row.erase("steps_matches");
      row.erase("steps_ms");
      row["steps"] = toJson(method.steps);
      out["results"].push_back(std::move(row));
    }
  }
  for (const SetSummary& summary : summarizeSets(scores)) out["summary"].push_back(toJson(summary));
  return out;
}

std::string toCsv(const std::vector<PairScore>& scores) {
  files::CsvRow header;
  for (const char* column : kColumns) header.add(column);
  std::string out = header.line();
  for (const PairScore& pair : scores) {
    for (const MethodScore& method : pair.methods) {
      const json values = toRow(pair, method);
      files::CsvRow row;
      for (const char* column : kColumns) add(values.at(column), row);
      out += row.line();
    }
  }
  return out;
}

std::string toTable(const std::vector<SetSummary>& summaries) {
  std::string out;
  std::string set;
  for (const SetSummary& s : summaries) {
    if (s.set != set) {
      set = s.set;
      out += format("\n%s, %zu pairs\n", set.c_str(), s.pairs);
      out += format(
          "%-12s %8s %6s %8s %9s %8s | %5s %5s %5s %5s %8s %6s %6s %6s %6s %7s %6s | %8s\n",
          "method", "matches", "kept", "correct", "precision", "error px", "AUC@1", "@3", "@5",
          "@10", "median", "found", "wrong", "ZNCC", "true/p", "e'S^-1e", "99.9%", "ms");
    }
    out += format("%-12s %8.1f %5.1f%% %8.1f %8.1f%% ", s.method.c_str(), s.matches,
                  100.0 * s.retention, s.correct, 100.0 * s.precision[2]);
    const bool has_error = s.reprojection_error.count > 0;
    out += has_error ? format("%8.2f | ", s.reprojection_error.mean) : format("%8s | ", "-");
    out += toColumns(s.accuracy) + format(" | %8.2f\n", s.total_milliseconds);
  }
  return out;
}

}  // namespace ktgp_orb::evaluation
