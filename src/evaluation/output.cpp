#include "evaluation/output.h"

#include <algorithm>
#include <cstdio>
#include <sstream>

namespace ktgp_orb::tools {
namespace {

using nlohmann::json;

/// Sums up values that not every pair has.
struct Average {
  double mean = 0.0;
  double rms = 0.0;
  std::size_t pairs = 0;

  void add(const ErrorSummary& summary) {
    if (summary.count == 0) return;
    mean += summary.mean;
    rms += summary.rms;
    ++pairs;
  }
  ErrorSummary summary() const {
    if (pairs == 0) return {};
    const auto n = static_cast<double>(pairs);
    return {pairs, mean / n, rms / n};
  }
};

SetSummary summarizeMethod(const std::string& set, std::size_t method,
                           const std::vector<const PairScore*>& scores) {
  SetSummary s;
  s.set = set;
  s.pairs = scores.size();
  const auto n = static_cast<double>(scores.size());
  Average distance, displacement, reprojection;
  std::vector<double> corner_errors;
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
    for (std::size_t i = 0; i < m.precision.size(); ++i) s.precision[i] += m.precision[i] / n;
    distance.add(m.descriptor_distance);
    displacement.add(m.displacement);
    reprojection.add(m.reprojection_error);
    if (m.corner_error) corner_errors.push_back(*m.corner_error);
  }
  s.descriptor_distance = distance.summary();
  s.displacement = displacement.summary();
  s.reprojection_error = reprojection.summary();
  if (!corner_errors.empty()) {
    s.auc.emplace();
    for (std::size_t i = 0; i < kAucThresholds.size(); ++i) {
      (*s.auc)[i] = areaUnderCurve(corner_errors, kAucThresholds[i]);
    }
  }
  return s;
}

/// "1px" for the keys of JSON and CSV.
std::string px(double threshold) {
  std::ostringstream out;
  out << threshold << "px";
  return out.str();
}

void put(json& out, const std::string& key, const ErrorSummary& summary) {
  out[key + "_mean"] = summary.count > 0 ? json(summary.mean) : json(nullptr);
  out[key + "_rms"] = summary.count > 0 ? json(summary.rms) : json(nullptr);
}

template <typename Values, typename Thresholds>
void put(json& out, const std::string& key, const Values& values, const Thresholds& thresholds) {
  for (std::size_t i = 0; i < values.size(); ++i) out[key + "_" + px(thresholds[i])] = values[i];
}

/// The columns of the CSV file, which are keys of toRow.
constexpr std::array<const char*, 25> kColumns{"set",
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
                                               "corner_error",
                                               "extraction_ms",
                                               "ms",
                                               "steps_matches",
                                               "steps_ms"};

/// "knn=38.20;ratio=0.02", for one field of a CSV row.
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
           {"reference_keypoints", pair.reference_keypoints},
           {"target_keypoints", pair.target_keypoints},
           {"detector_repeatability", pair.detector_repeatability},
           {"extraction_ms", pair.extraction_milliseconds},
           {"matches", m.matches},
           {"retention", m.retention},
           {"rep_eq9", m.matched_share},
           {"correct_3px", m.correct},
           {"corner_error", m.corner_error ? json(*m.corner_error) : json(nullptr)},
           {"homography_sought", m.corner_error.has_value()},
           {"ms", m.milliseconds},
           {"steps_matches", joined(m.steps, [](const StepResult& s) { return s.matches; })},
           {"steps_ms", joined(m.steps, [](const StepResult& s) { return s.milliseconds; })}};
  put(row, "descriptor_distance", m.descriptor_distance);
  put(row, "displacement", m.displacement);
  put(row, "reprojection_error", m.reprojection_error);
  put(row, "precision", m.precision, kPrecisionThresholds);
  return row;
}

json toJson(const std::vector<StepResult>& steps) {
  json out = json::array();
  for (const StepResult& step : steps) {
    out.push_back({{"name", step.name}, {"matches", step.matches}, {"ms", step.milliseconds}});
  }
  return out;
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
           {"ms", s.milliseconds}};
  put(out, "descriptor_distance", s.descriptor_distance);
  put(out, "displacement", s.displacement);
  put(out, "reprojection_error", s.reprojection_error);
  put(out, "precision", s.precision, kPrecisionThresholds);
  if (s.auc) put(out, "auc", *s.auc, kAucThresholds);
  return out;
}

/// A value as a field of a CSV row; nothing for null and infinity.
std::string toField(const json& value) {
  if (!value.is_string()) return value.dump() == "null" ? "" : value.dump();
  auto text = value.get<std::string>();
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string out = "\"";
  for (char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
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
  std::string out;
  for (const char* column : kColumns) out += (out.empty() ? "" : ",") + std::string(column);
  out += '\n';
  for (const PairScore& pair : scores) {
    for (const MethodScore& method : pair.methods) {
      const json row = toRow(pair, method);
      std::string line;
      for (const char* column : kColumns) {
        if (column != kColumns.front()) line += ',';
        line += toField(row.at(column));
      }
      out += line + '\n';
    }
  }
  return out;
}

std::string toTable(const std::vector<SetSummary>& summaries) {
  std::string out;
  char line[256];
  std::string set;
  for (const SetSummary& s : summaries) {
    if (s.set != set) {
      set = s.set;
      std::snprintf(line, sizeof(line), "\n%s, %zu pairs\n%-12s %8s %7s %8s %9s %9s %7s %9s\n",
                    set.c_str(), s.pairs, "method", "matches", "kept", "correct", "precision",
                    "error px", "AUC@3", "ms");
      out += line;
    }
    std::snprintf(line, sizeof(line), "%-12s %8.1f %6.1f%% %8.1f %8.1f%% %9.2f ", s.method.c_str(),
                  s.matches, 100.0 * s.retention, s.correct, 100.0 * s.precision[2],
                  s.reprojection_error.mean);
    out += line;
    std::snprintf(line, sizeof(line), "%6.1f%%", s.auc ? 100.0 * (*s.auc)[1] : 0.0);
    out += s.auc ? line : "      -";
    std::snprintf(line, sizeof(line), " %9.2f\n", s.milliseconds);
    out += line;
  }
  return out;
}

}  // namespace ktgp_orb::tools
