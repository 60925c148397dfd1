// Prints the table of doc/tuning.md on the distribution of keypoints: matches, their precision and
// the error of the homography with each, on the Oxford sets below $KTGP_ORB_DATA/oxford.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "ktgp_orb/evaluation.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"

namespace {

using ktgp_orb::Features;
using ktgp_orb::KeypointDistribution;
using ktgp_orb::Level;
using ktgp_orb::MatchResult;
using ktgp_orb::OrbOptions;

constexpr double kWorstCornerError = 10;  // px, where the recall curve ends
constexpr int kSeeds = 20;                // of PROSAC, averaged over

struct Set {
  std::string folder;
  std::string extension;
  bool turned;  // GMS needs rotation and scale
};

/// Sums over pairs of images.
struct Score {
  double matches = 0;  // after GMS
  double correct = 0;  // of them
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
  const cv::Mat image = cv::imread(file, cv::IMREAD_GRAYSCALE);
  if (image.empty()) throw std::runtime_error("cannot read image " + file);
  Features features;
  ktgp_orb::OrbExtractor(options).extract(image, features);
  return features;
}

Eigen::Matrix3d readHomography(const std::string& file) {
  Eigen::Matrix3d h;
  std::ifstream in(file);
  for (int i = 0; i < 9; ++i) in >> h(i / 3, i % 3);
  if (!in) throw std::runtime_error("cannot read the homography " + file);
  return h;
}

Eigen::Vector2d map(const Eigen::Matrix3d& h, const cv::Point2f& p) {
  return (h * Eigen::Vector3d(p.x, p.y, 1)).hnormalized();
}

double meanCornerError(const MatchResult& result, const Eigen::Matrix3d& truth,
                       const cv::Size& size) {
  if (result.status != ktgp_orb::Status::ok) return kWorstCornerError;
  const auto right = static_cast<float>(size.width - 1);
  const auto bottom = static_cast<float>(size.height - 1);
  double sum = 0;
  for (const cv::Point2f corner : {cv::Point2f(0, 0), cv::Point2f(right, 0), cv::Point2f(0, bottom),
                                   cv::Point2f(right, bottom)}) {
    sum += (map(truth, corner) - map(result.homography, corner)).norm();
  }
  return sum / 4;
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
    for (const auto& match : result.correspondences) {
      if (match.level < Level::ktg) continue;
      const cv::Point2f q = target.keypoints[match.target_index].pt;
      const Eigen::Vector2d expected = map(truth, reference.keypoints[match.reference_index].pt);
      ++score.matches;
      if ((expected - Eigen::Vector2d(q.x, q.y)).norm() <= ktgp_orb::evaluation::kCorrectWithin)
        ++score.correct;
    }
    score.precision = score.matches > 0 ? score.correct / score.matches : 0;
  }
  return score;
}

Score scoreSet(const OrbOptions& options, const std::string& root, const Set& set) {
  const std::string folder = root + "/oxford/" + set.folder + "/";
  const std::string end = "." + set.extension;
  const Features reference = extract(options, folder + "img1" + end);
  Score sum;
  for (const std::string k : {"2", "3", "4", "5", "6"}) {
    std::string image = folder + "img";
    image.append(k).append(end);
    std::string homography = folder + "H1to";
    homography.append(k).append("p");
    sum += scorePair(reference, extract(options, image), readHomography(homography), set.turned);
  }
  return sum;
}

void printRow(const std::string& name, const OrbOptions& options, const std::string& root) {
  const Set sets[] = {{"leuven", "ppm", false}, {"bikes", "ppm", false}, {"boat", "pgm", true}};
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
  const char* root = std::getenv("KTGP_ORB_DATA");
  try {
    if (root == nullptr) throw std::runtime_error("set KTGP_ORB_DATA to what holds oxford/");
    for (int features : {500, 1000, 2000, 4000}) printTable(root, features);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
