#include "evaluation/hpatches.h"

#include <algorithm>
#include <array>

#include "evaluation/peers.h"
#include "util/format.h"

namespace ktgp_orb::evaluation::hpatches {
namespace {

constexpr std::array<const char*, 8> kLarge{"i_contruction", "i_crownnight",    "i_dc",
                                            "i_pencils",     "i_whitebuilding", "v_artisans",
                                            "v_astronautis", "v_talent"};

/// AUC at 1, 3 and 5 px in %, from the README of https://github.com/cvg/glue-factory: 1024
/// keypoints, and for each estimator the threshold with the best result.
constexpr std::array<std::pair<const char*, std::array<double, 3>>, 4> kPublished{
    {{"SuperPoint + SuperGlue, OpenCV", {32.9, 55.7, 68.0}},
     {"SuperPoint + SuperGlue, PoseLib", {37.0, 68.2, 78.7}},
     {"SuperPoint + LightGlue, OpenCV", {34.2, 57.9, 69.9}},
     {"SuperPoint + LightGlue, PoseLib", {37.1, 67.4, 77.8}}}};

std::string row(const std::string& method, double at_1, double at_3, double at_5,
                const std::string& rest) {
  return util::format("%-32s %6.1f %6.1f %6.1f  %s\n", method.c_str(), at_1, at_3, at_5,
                      rest.c_str());
}

std::string measuredRow(const SetSummary& s) {
  if (!s.accuracy) return s.method + ": estimates no homography\n";
  const std::string rest =
      util::format("%6.1f %%  %8.1f", 100.0 * s.accuracy->found, s.total_milliseconds);
  const auto& auc = s.accuracy->auc;
  static_assert(kAucThresholds[0] == 1.0 && kAucThresholds[1] == 3.0 && kAucThresholds[2] == 5.0);
  return row(s.method, 100.0 * auc[0], 100.0 * auc[1], 100.0 * auc[2], rest);
}

}  // namespace

void leaveOutLarge(Dataset& dataset) {
  const auto is_large = [](const ImagePair& pair) {
    return std::find(kLarge.begin(), kLarge.end(), pair.set) != kLarge.end();
  };
  std::vector<ImagePair>& pairs = dataset.pairs;
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(), is_large), pairs.end());
}

std::vector<std::string> methodNames() {
  return {"KTGP", "KTGP+ALIGN", "ROBUST", "SIFT+PROSAC", "AKAZE", "ORB+RANSAC"};
}

Method siftWithOurEstimator(const PipelineOptions& options) {
  for (Method& method : peerMethods(options.matcher.prosac, "prosac")) {
    if (method.name != "SIFT") continue;
    method.name = "SIFT+PROSAC";
    method.description = "2000 SIFT keypoints, ratio 0.8, PROSAC";
    return method;
  }
  return {};
}

std::string toTable(const std::vector<SetSummary>& summaries) {
  if (summaries.empty()) return "";
  // The last entry is for all sets together.
  const SetSummary& last = summaries.back();
  std::string out = "HPatches, " + std::to_string(last.pairs) +
                    " pairs (the papers: 540), shorter side 480 px; AUC of the mean corner error "
                    "in %\n";
  out += "method                              1 px   3 px   5 px     found  ms a pair\n";
  for (const SetSummary& s : summaries) {
    if (s.set == last.set) out += measuredRow(s);
  }
  out += "quoted, not measured here, all 540 pairs (README of github.com/cvg/glue-factory):\n";
  for (const auto& [method, auc] : kPublished) {
    out += row(method, auc[0], auc[1], auc[2], "quoted");
  }
  return out;
}

}  // namespace ktgp_orb::evaluation::hpatches
