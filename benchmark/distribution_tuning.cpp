// Prints the table of doc/measurements/distribution.md: matches, their precision and the error of
// the homography for each distribution, on the Oxford sets below $KTGP_ORB_DATA/oxford.

#include <Eigen/Core>
#include <algorithm>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

#include "files/input.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/orb_extractor.h"
#include "support.h"

namespace {

using ktgp_orb::Correspondence;
using ktgp_orb::Features;
using ktgp_orb::KeypointDistribution;
using ktgp_orb::Level;
using ktgp_orb::MatchResult;
using ktgp_orb::OrbOptions;

constexpr double kWorstCornerError = 10;  // px; end of the recall curve
constexpr int kSeeds = 20;                // random seeds of PROSAC; the results are averaged

struct Set {
  std::string name;
  bool turned;  // GMS needs rotation and scale
};

/// Sums over pairs of images.
struct Score {
  double matches = 0;  // number of matches after GMS
  double correct = 0;  // number of correct matches
  double precision = 0;
  double corner_auc = 0;  // area under the recall of the mean corner error up to 10 px

  Score& operator+=(const Score& other) {
    matches += other.matches;
    correct += other.correct;
    precision += other.precision;
    corner_auc += other.corner_auc;
    return *this;
  }
};

Features extract(const OrbOptions& options, const std::string& file) {
  Features features;
  ktgp_orb::OrbExtractor(options).extract(ktgp_orb::files::readGrey(file), features);
  return features;
}

double meanCornerError(const MatchResult& result, const Eigen::Matrix3d& truth,
                       const cv::Size& size) {
  if (result.status != ktgp_orb::Status::ok) return kWorstCornerError;
  return ktgp_orb::metrics::cornerError(result.answer.homography, truth, size);
}

Score scorePair(const Features& reference, const Features& target, const Eigen::Matrix3d& truth,
                bool turned) {
  Score score;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    ktgp_orb::MatcherOptions options;
    options.gms.rotation = options.gms.scale = turned;
    options.prosac.seed = static_cast<std::uint64_t>(seed);
    MatchResult result;
    ktgp_orb::KtgpMatcher(options).match(reference, target, result);
    const double error = meanCornerError(result, truth, reference.image_size);
    score.corner_auc += std::max(0.0, 1 - error / kWorstCornerError) / kSeeds;
    if (seed > 1) continue;  // GMS has no seed
    std::vector<Correspondence> matches;
    result.surviving(Level::ktg, matches);
    const std::vector<double> errors =
        ktgp_orb::metrics::reprojectionErrors(truth, reference, target, matches);
    score.matches = static_cast<double>(matches.size());
    score.correct = static_cast<double>(
        ktgp_orb::metrics::countWithin(errors, ktgp_orb::metrics::kCorrectWithin));
    score.precision = score.matches > 0 ? score.correct / score.matches : 0;
  }
  return score;
}

Score scoreSet(const OrbOptions& options, const std::string& root, const Set& set) {
  const auto image = [&](int number) {
    return extract(options, ktgp_orb::bench::oxfordImage(root, set.name, number));
  };
  const Features reference = image(1);
  Score sum;
  for (int k = 2; k <= 6; ++k) {
    const Eigen::Matrix3d truth =
        ktgp_orb::files::readHomography(ktgp_orb::bench::oxfordTruth(root, set.name, k));
    sum += scorePair(reference, image(k), truth, set.turned);
  }
  return sum;
}

void printRow(const std::string& name, const OrbOptions& options, const std::string& root) {
  const Set sets[] = {{"leuven", false}, {"bikes", false}, {"boat", true}};
  std::printf("| %s |", name.c_str());
  for (const Set& set : sets) {
    const Score score = scoreSet(options, root, set);
    std::printf(" %.0f | %.1f | %.3f |", score.correct / 5, 100 * score.precision / 5,
                score.corner_auc / 5);
  }
  std::printf("\n");
}

void printTable(const std::string& root, int features) {
  std::printf("\n**%d features**\n\n", features);
  std::printf(
      "| distribution | Leuven correct | precision %% | AUC | Bikes correct |"
      " precision %% | AUC | Boat correct | precision %% | AUC |\n");
  std::printf("|---|---|---|---|---|---|---|---|---|---|\n");
  OrbOptions options;
  options.max_features = features;
  printRow("ranked", options, root);
  options.distribution = KeypointDistribution::uniform;
  for (int share : {2, 4, 8, 16, 32, 64}) {
    options.keypoints_per_cell = share;
    printRow("uniform, cell share " + std::to_string(share), options, root);
  }
}

}  // namespace

int main() {
  const auto root = ktgp_orb::bench::oxfordFolder();
  try {
    if (!root) throw std::runtime_error("set KTGP_ORB_DATA to what holds oxford/");
    for (int features : {500, 1000, 2000, 4000}) printTable(*root, features);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
