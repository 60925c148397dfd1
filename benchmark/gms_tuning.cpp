// Prints the tables of doc/measurements/gms.md: the effect of T_G, rotation and scale on the number
// of matches and their precision, on the Oxford sets below $KTGP_ORB_DATA/oxford.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "files/input.h"
#include "ktgp_orb/gms_filter.h"
#include "ktgp_orb/knn_matcher.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/ratio_filter.h"
#include "support.h"

namespace {

using ktgp_orb::Correspondence;
using ktgp_orb::Features;
using ktgp_orb::GmsOptions;
using ktgp_orb::Level;

struct Pair {
  std::string name;
  Features reference, target;
  Eigen::Matrix3d truth;  ///< reference to target
  std::vector<Correspondence> nearest;
};

Features extract(const std::string& file, int most) {
  Features features;
  ktgp_orb::OrbOptions options;
  options.max_features = most;
  ktgp_orb::OrbExtractor(options).extract(ktgp_orb::files::readGrey(file), features);
  return features;
}

Pair readPair(const std::string& folder, const std::string& set, int k, int features) {
  using namespace ktgp_orb::bench;
  Pair pair;
  pair.name = "1-" + std::to_string(k);
  pair.reference = extract(oxfordImage(folder, set, 1), features);
  pair.target = extract(oxfordImage(folder, set, k), features);
  pair.truth = ktgp_orb::files::readHomography(oxfordTruth(folder, set, k));
  ktgp_orb::KnnMatcher().match(pair.reference.descriptors, pair.target.descriptors, pair.nearest);
  return pair;
}

std::vector<Pair> readSet(const std::string& folder, const std::string& set, int features = 2000) {
  std::vector<Pair> pairs;
  for (int k = 2; k <= 6; ++k) pairs.push_back(readPair(folder, set, k, features));
  return pairs;
}

struct Count {
  double matches = 0.0;
  double correct = 0.0;
};

bool isCorrect(const Pair& pair, const Correspondence& c) {
  const cv::Point2f& r = pair.reference.keypoints[static_cast<std::size_t>(c.reference_index)].pt;
  const cv::Point2f& t = pair.target.keypoints[static_cast<std::size_t>(c.target_index)].pt;
  const Eigen::Vector2d p = (pair.truth * Eigen::Vector3d(r.x, r.y, 1.0)).hnormalized();
  return (p - Eigen::Vector2d(t.x, t.y)).norm() <= ktgp_orb::metrics::kCorrectWithin;
}

/// Counts the matches after the ratio filter at T_w (0: no filter) and then GMS (null: no GMS).
Count run(const Pair& pair, double ratio_threshold, const GmsOptions* gms) {
  std::vector<Correspondence> matches = pair.nearest;
  if (ratio_threshold > 0.0) {
    ktgp_orb::filterByRatio(ratio_threshold, matches);
  } else {
    for (Correspondence& c : matches) c.level = Level::kt;
  }
  if (gms != nullptr) ktgp_orb::GmsFilter(*gms).filter(pair.reference, pair.target, matches);
  Count count;
  for (const Correspondence& c : matches) {
    if (c.level < (gms != nullptr ? Level::ktg : Level::kt)) continue;
    count.matches += 1.0;
    count.correct += isCorrect(pair, c) ? 1.0 : 0.0;
  }
  return count;
}

Count average(const std::vector<Pair>& pairs, double ratio_threshold, const GmsOptions* gms) {
  Count sum;
  for (const Pair& pair : pairs) {
    const Count count = run(pair, ratio_threshold, gms);
    sum.matches += count.matches / static_cast<double>(pairs.size());
    sum.correct += count.correct / static_cast<double>(pairs.size());
  }
  return sum;
}

void printCells(const Count& count) {
  std::printf(" %.0f | %.0f | %.1f |", count.matches, count.correct,
              count.matches > 0.0 ? 100.0 * count.correct / count.matches : 0.0);
}

void printThresholds(const char* name, const std::vector<Pair>& pairs, GmsOptions options) {
  std::printf("\n%s\n\n", name);
  std::printf("| T_G | NM after TF | correct | precision %% | NM without TF | correct | ");
  std::printf("precision %% |\n|---|---|---|---|---|---|---|\n");
  for (int threshold = -1; threshold <= 9; ++threshold) {
    options.threshold = threshold;
    const GmsOptions* gms = threshold < 0 ? nullptr : &options;
    std::printf("| %s |", gms == nullptr ? "no GMS" : std::to_string(threshold).c_str());
    for (const double ratio : {ktgp_orb::kDefaultRatioThreshold, 0.0}) {
      printCells(average(pairs, ratio, gms));
    }
    std::printf("\n");
  }
}

void printModes(const char* name, const std::vector<Pair>& pairs, double ratio_threshold) {
  std::printf("\n%s\n\n", name);
  std::printf("| pair | no GMS | plain | rotation | scale | rotation + scale |\n");
  std::printf("|---|---|---|---|---|---|\n");
  for (const Pair& pair : pairs) {
    std::printf("| %s |", pair.name.c_str());
    for (int mode = -1; mode < 4; ++mode) {
      GmsOptions options;
      options.rotation = (mode & 1) != 0;
      options.scale = (mode & 2) != 0;
      const Count count = run(pair, ratio_threshold, mode < 0 ? nullptr : &options);
      std::printf(" %.0f of %.0f |", count.correct, count.matches);
    }
    std::printf("\n");
  }
}

void printGrids(const char* name, const std::vector<Pair>& pairs) {
  std::printf("\n%s\n\n", name);
  std::printf("| grid | NM at T_G = 3 | correct | precision %% | NM at T_G = 6 | correct | ");
  std::printf("precision %% |\n|---|---|---|---|---|---|---|\n");
  for (const int cells : {20, 14, 10, 7}) {
    std::printf("| %d × %d |", cells, cells);
    for (const double threshold : {3.0, 6.0}) {
      GmsOptions options;
      options.threshold = threshold;
      options.grid_columns = options.grid_rows = cells;
      printCells(average(pairs, ktgp_orb::kDefaultRatioThreshold, &options));
    }
    std::printf("\n");
  }
}

}  // namespace

int main() {
  const auto oxford = ktgp_orb::bench::oxfordFolder();
  if (!oxford) {
    std::fprintf(stderr, "KTGP_ORB_DATA is not set: expected the folder that holds oxford/\n");
    return 2;
  }
  try {
    const std::vector<Pair> leuven = readSet(*oxford, "leuven");
    const std::vector<Pair> bikes = readSet(*oxford, "bikes");
    const std::vector<Pair> boat = readSet(*oxford, "boat");
    GmsOptions plain;
    GmsOptions turning;
    turning.rotation = turning.scale = true;
    printThresholds("Leuven (lighting), plain GMS, mean of five pairs", leuven, plain);
    printThresholds("Bikes (blur), plain GMS, mean of five pairs", bikes, plain);
    printThresholds("Boat (rotation and zoom), GMS with rotation and scale, mean of five pairs",
                    boat, turning);
    printModes("Boat after TF, T_G = 6: correct of all kept", boat,
               ktgp_orb::kDefaultRatioThreshold);
    printModes("Leuven after TF, T_G = 6: correct of all kept", leuven,
               ktgp_orb::kDefaultRatioThreshold);
    printModes("Bikes after TF, T_G = 6: correct of all kept", bikes,
               ktgp_orb::kDefaultRatioThreshold);
    const std::vector<Pair> few = readSet(*oxford, "leuven", 500);
    printGrids("Leuven with 500 features after TF, mean of five pairs", few);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return 0;
}
