// Compares the accuracy of ProsacHomography and cv::findHomography on identical matches of real
// images, as Markdown. Needs the Oxford sets: KTGP_ORB_DATA=<folder that holds
// oxford/leuven/img1.ppm, ...>. Argument: number of generated homographies for each of the 18
// images, 7 by default.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "files/input.h"
#include "ktgp_orb/gms_filter.h"
#include "ktgp_orb/knn_matcher.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/prosac_homography.h"
#include "ktgp_orb/ratio_filter.h"
#include "support.h"
#include "util/constants.h"
#include "util/keypoint_position.h"
#include "util/random.h"

namespace ktgp_orb {
namespace {

using util::kPi;
using util::position;
using util::Random;

constexpr int kRuns = 20;  // seeds for us; orders of matches for OpenCV, whose seed is fixed
constexpr double kThreshold = 3.0;

struct Pair {
  std::string name;
  cv::Size size;
  PointPairs points;
  Eigen::Matrix3d truth;
};

using Estimator = std::function<Eigen::Matrix3d(const Pair&, int run)>;
struct Named {
  std::string name;
  Estimator estimate;  // returns zero if there is no model
};

double cornerError(const Eigen::Matrix3d& estimate, const Pair& pair) {
  return metrics::cornerError(estimate, pair.truth, pair.size);
}

double percentUnderCurve(const std::vector<double>& errors, double limit) {
  return 100.0 * metrics::areaUnderCurve(errors, limit);
}

std::vector<std::size_t> shuffled(std::size_t n, int run) {
  std::vector<std::size_t> order(n);
  for (std::size_t i = 0; i < n; ++i) order[i] = i;
  Random random(static_cast<std::uint64_t>(run) + 1);
  for (std::size_t i = n; i > 1; --i) {
    std::swap(order[i - 1], order[random.below(static_cast<std::uint32_t>(i))]);
  }
  return order;
}

Estimator openCv(int method) {
  return [method](const Pair& pair, int run) -> Eigen::Matrix3d {
    std::vector<cv::Point2f> from;
    std::vector<cv::Point2f> to;
    for (std::size_t i : shuffled(pair.points.size(), run)) {
      from.emplace_back(static_cast<float>(pair.points.reference[i].x()),
                        static_cast<float>(pair.points.reference[i].y()));
      to.emplace_back(static_cast<float>(pair.points.target[i].x()),
                      static_cast<float>(pair.points.target[i].y()));
    }
    Eigen::Matrix3d homography = Eigen::Matrix3d::Zero();
    if (from.size() < 4) return homography;
    const cv::Mat h = cv::findHomography(from, to, method, kThreshold);
    if (!h.empty()) cv::cv2eigen(h, homography);
    return homography;
  };
}

Estimator prosac() {
  return [](const Pair& pair, int run) -> Eigen::Matrix3d {
    ProsacOptions options;
    options.max_error = kThreshold;
    options.seed = static_cast<std::uint64_t>(run) + 1;
    ProsacHomography estimator(options);
    ProsacResult result;
    estimator.estimate(pair.points, pair.size, result);
    return result.answer.homography;
  };
}

std::vector<Named> estimators() {
  return {{"RANSAC", openCv(cv::RANSAC)},
          {"RHO", openCv(cv::RHO)},
          {"USAC_DEFAULT", openCv(cv::USAC_DEFAULT)},
          {"USAC_MAGSAC", openCv(cv::USAC_MAGSAC)},
          {"USAC_ACCURATE", openCv(cv::USAC_ACCURATE)},
          {"ProsacHomography", prosac()}};
}

Features extract(const cv::Mat& image) {
  Features features;
  features.image_size = image.size();
  cv::ORB::create(2000)->detectAndCompute(image, cv::noArray(), features.keypoints,
                                          features.descriptors);
  return features;
}

struct Filters {
  std::string name;
  double ratio;
  bool gms;
};

PointPairs match(const Features& reference, const Features& target, const Filters& filters) {
  std::vector<Correspondence> correspondences;
  KnnMatcher().match(reference.descriptors, target.descriptors, correspondences);
  filterByRatio(filters.ratio, correspondences);
  if (filters.gms) {
    GmsOptions options;
    options.rotation = options.scale = true;
    GmsFilter(options).filter(reference, target, correspondences);
  }
  PointPairs points;
  for (const Correspondence& c : correspondences) {
    if (c.level < (filters.gms ? Level::ktg : Level::kt)) continue;
    points.add(position(reference, c.reference_index), position(target, c.target_index), c.ratio());
  }
  return points;
}

std::vector<Pair> oxfordPairs(const std::string& folder, const Filters& filters) {
  std::vector<Pair> pairs;
  for (const std::string set : {"leuven", "bikes", "boat"}) {
    const Features reference = extract(files::readGrey(bench::oxfordImage(folder, set, 1)));
    for (int k = 2; k <= 6; ++k) {
      Pair pair;
      pair.name = set + " 1-" + std::to_string(k);
      pair.size = reference.image_size;
      pair.points =
          match(reference, extract(files::readGrey(bench::oxfordImage(folder, set, k))), filters);
      pair.truth = files::readHomography(bench::oxfordTruth(folder, set, k));
      pairs.push_back(std::move(pair));
    }
  }
  return pairs;
}

double uniform(Random& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random.next() >> 11) * 0x1p-53;
}

/// Moves each corner by up to 15 % of the image, after a turn of up to 30 degrees and a zoom of 0.7
/// to 1.4 about the centre.
Eigen::Matrix3d randomHomography(const cv::Size& size, Random& random) {
  const double angle = uniform(random, -kPi / 6, kPi / 6);
  const double zoom = std::exp(uniform(random, std::log(0.7), std::log(1.4)));
  const cv::Point2f centre(static_cast<float>(size.width) / 2, static_cast<float>(size.height) / 2);
  const auto w = static_cast<float>(size.width - 1);
  const auto h = static_cast<float>(size.height - 1);
  const cv::Point2f from[4] = {{0, 0}, {w, 0}, {w, h}, {0, h}};
  cv::Point2f to[4];
  for (int i = 0; i < 4; ++i) {
    const cv::Point2f d = from[i] - centre;
    const double x = zoom * (std::cos(angle) * d.x - std::sin(angle) * d.y);
    const double y = zoom * (std::sin(angle) * d.x + std::cos(angle) * d.y);
    to[i].x = static_cast<float>(centre.x + x + size.width * uniform(random, -0.15, 0.15));
    to[i].y = static_cast<float>(centre.y + y + size.height * uniform(random, -0.15, 0.15));
  }
  Eigen::Matrix3d homography;
  cv::cv2eigen(cv::getPerspectiveTransform(from, to), homography);
  return homography;
}

void addNoise(double sigma, int seed, cv::Mat& image) {
  cv::Mat noise(image.size(), CV_16S);
  cv::RNG(static_cast<std::uint64_t>(seed)).fill(noise, cv::RNG::NORMAL, 0.0, sigma);
  cv::Mat sum;
  cv::add(image, noise, sum, cv::noArray(), CV_8U);
  image = sum;
}

/// Warps every image of the three sets by this number of homographies.
std::vector<Pair> warpedPairs(const std::string& folder, const Filters& filters, int homographies) {
  std::vector<Pair> pairs;
  Random random(2024);
  for (const std::string set : {"leuven", "bikes", "boat"}) {
    for (int k = 1; k <= 6; ++k) {
      const cv::Mat original = files::readGrey(bench::oxfordImage(folder, set, k));
      for (int i = 0; i < homographies; ++i) {
        Pair pair;
        pair.name = set + std::to_string(k) + "." + std::to_string(i);
        pair.size = original.size();
        pair.truth = randomHomography(pair.size, random);
        cv::Mat truth;
        cv::eigen2cv(pair.truth, truth);
        cv::Mat warped;
        cv::warpPerspective(original, warped, truth, original.size(), cv::INTER_CUBIC);
        cv::GaussianBlur(warped, warped, cv::Size(), uniform(random, 0.3, 2.0));
        warped.convertTo(warped, CV_8U, uniform(random, 0.5, 1.5), uniform(random, -20.0, 20.0));
        addNoise(uniform(random, 1.0, 8.0), static_cast<int>(random.next() >> 40), warped);
        pair.points = match(extract(original), extract(warped), filters);
        pairs.push_back(std::move(pair));
      }
    }
  }
  return pairs;
}

std::vector<double> errorsOf(const Named& estimator, const std::vector<Pair>& pairs, int runs) {
  std::vector<double> errors;
  for (const Pair& pair : pairs) {
    for (int run = 0; run < runs; ++run) {
      errors.push_back(cornerError(estimator.estimate(pair, run), pair));
    }
  }
  return errors;
}

void printOxford(const std::string& folder, const Filters& filters) {
  const std::vector<Pair> pairs = oxfordPairs(folder, filters);
  std::printf("\nOxford, %s: %zu pairs, %d runs each\n\n", filters.name.c_str(), pairs.size(),
              kRuns);
  std::printf("| estimator | AUC 3 px | AUC 5 px | AUC 10 px | wrong (> 20 px) | none |\n");
  std::printf("|---|---|---|---|---|---|\n");
  for (const Named& estimator : estimators()) {
    const std::vector<double> errors = errorsOf(estimator, pairs, kRuns);
    const double count = static_cast<double>(errors.size());
    const auto none =
        std::count_if(errors.begin(), errors.end(), [](double e) { return std::isinf(e); });
    const auto wrong =
        std::count_if(errors.begin(), errors.end(), [](double e) { return e > 20.0; }) - none;
    std::printf("| %s | %.1f | %.1f | %.1f | %.1f %% | %.1f %% |\n", estimator.name.c_str(),
                percentUnderCurve(errors, 3.0), percentUnderCurve(errors, 5.0),
                percentUnderCurve(errors, 10.0), 100.0 * static_cast<double>(wrong) / count,
                100.0 * static_cast<double>(none) / count);
  }
}

void printWarped(const std::string& folder, const Filters& filters, int homographies) {
  const std::vector<Pair> pairs = warpedPairs(folder, filters, homographies);
  std::printf("\nWarped, %s: %zu pairs, exact ground truth\n\n", filters.name.c_str(),
              pairs.size());
  std::printf("| estimator | median corner error (px) | 75 %% | 90 %% | AUC 1 px | AUC 3 px |\n");
  std::printf("|---|---|---|---|---|---|\n");
  for (const Named& estimator : estimators()) {
    std::vector<double> errors = errorsOf(estimator, pairs, 3);
    std::sort(errors.begin(), errors.end());
    const auto quantile = [&](double q) {
      return errors[static_cast<std::size_t>(q * static_cast<double>(errors.size()))];
    };
    std::printf("| %s | %.4f | %.3f | %.3g | %.1f | %.1f |\n", estimator.name.c_str(),
                metrics::median(errors), quantile(0.75), quantile(0.9),
                percentUnderCurve(errors, 1.0), percentUnderCurve(errors, 3.0));
  }
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  const int homographies = argc > 1 ? std::atoi(argv[1]) : 7;
  const auto folder = ktgp_orb::bench::oxfordFolder();
  if (!folder) {
    std::fprintf(stderr, "KTGP_ORB_DATA is not set: this program needs the Oxford sets\n");
    return 1;
  }
  using ktgp_orb::Filters;
  const Filters loose{"TF 0.8", 0.8, false};
  const Filters strict{"TF 0.66 + GMS with rotation and scale", 0.66, true};
  for (const Filters& filters : {loose, strict}) ktgp_orb::printOxford(*folder, filters);
  for (const Filters& filters : {loose, strict})
    ktgp_orb::printWarped(*folder, filters, homographies);
  return 0;
}
