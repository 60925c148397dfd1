#include "evaluation/estimators.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "ktgp_orb/metrics.h"
#include "util/constants.h"

// MAGSAC++ of OpenCV 4.5.1 crashes on few or coincident points; OpenCV 4.6 does not.
#define KTGP_ORB_HAVE_USAC (CV_VERSION_MAJOR > 4 || (CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR > 5))

namespace ktgp_orb::evaluation {
namespace {

constexpr std::size_t kSampleSize = 4;

std::vector<cv::Point2f> toOpenCv(const std::vector<Eigen::Vector2d>& points) {
  std::vector<cv::Point2f> out;
  out.reserve(points.size());
  for (const auto& p : points) {
    out.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  }
  return out;
}

std::vector<double> squaredErrors(const Eigen::Matrix3d& h, const PointPairs& pairs) {
  std::vector<double> errors(pairs.size());
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double e = (metrics::project(h, pairs.reference[i]) - pairs.target[i]).norm();
    errors[i] = std::isfinite(e) ? e * e : std::numeric_limits<double>::max();
  }
  return errors;
}

/// Finds the inliers anew, as OpenCV's mask belongs to the model before its last refinement.
ProsacResult conclude(const cv::Mat& h, const PointPairs& pairs, double threshold) {
  ProsacResult result;
  result.mask.assign(pairs.size(), 0);
  result.answer.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  if (h.empty()) return result;
  cv::cv2eigen(h, result.answer.homography);
  const std::vector<double> errors = squaredErrors(result.answer.homography, pairs);
  for (std::size_t i = 0; i < errors.size(); ++i) {
    result.mask[i] = errors[i] < threshold * threshold ? 1 : 0;
  }
  result.inliers = static_cast<std::size_t>(std::count(result.mask.begin(), result.mask.end(), 1));
  if (result.inliers >= kSampleSize) result.status = Status::ok;
  return result;
}

/// MSAC cost of a model (smaller is better): squared errors, limited at the threshold.
double msacCost(const std::vector<double>& squared_errors, double threshold) {
  double cost = 0.0;
  for (double e : squared_errors) cost += std::min(e, threshold * threshold);
  return cost;
}

/// MLESAC cost of a model: -log likelihood of the errors under g N(0, sigma) + (1 - g) / area.
/// Expectation maximisation finds the share of inliers g.
double mlesacCost(const std::vector<double>& squared_errors, double threshold, double area) {
  const double variance = threshold * threshold / 5.99;  // 95 % of a 2-D Gaussian is within
  std::vector<double> inlier(squared_errors.size());
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    inlier[i] = std::exp(-0.5 * squared_errors[i] / variance) / (2.0 * util::kPi * variance);
  }
  double g = 0.5;
  for (int iteration = 0; iteration < 5; ++iteration) {
    double sum = 0.0;
    for (double p : inlier) sum += g * p / (g * p + (1.0 - g) / area);
    g = std::clamp(sum / static_cast<double>(inlier.size()), 1e-3, 1.0 - 1e-3);
  }
  double cost = 0.0;
  for (double p : inlier) cost -= std::log(g * p + (1.0 - g) / area);
  return cost;
}

std::array<std::size_t, kSampleSize> drawSample(std::size_t n, std::mt19937_64& random) {
  std::array<std::size_t, kSampleSize> sample{};
  for (std::size_t i = 0; i < kSampleSize;) {
    sample[i] = random() % n;
    const auto end = sample.begin() + static_cast<std::ptrdiff_t>(i);
    if (std::find(sample.begin(), end, sample[i]) == end) ++i;
  }
  return sample;
}

/// Number of samples after which one sample has only inliers, with the given confidence.
double samplesNeeded(double inlier_share, double confidence) {
  const double all_inliers = std::pow(inlier_share, kSampleSize);
  if (all_inliers >= 1.0) return 0.0;
  return std::log(1.0 - confidence) / std::log1p(-all_inliers);
}

/// Fits the model to its inliers by least squares, in a few rounds because the inliers then change.
ProsacResult fitAgain(ProsacResult model, const std::vector<cv::Point2f>& reference,
                      const std::vector<cv::Point2f>& target, const PointPairs& pairs,
                      double threshold) {
  for (int round = 0; round < 4; ++round) {
    std::vector<cv::Point2f> from;
    std::vector<cv::Point2f> to;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      if (model.mask[i] == 0) continue;
      from.push_back(reference[i]);
      to.push_back(target[i]);
    }
    ProsacResult refined = conclude(cv::findHomography(from, to, 0), pairs, threshold);
    if (refined.status != Status::ok) break;
    model = std::move(refined);
  }
  return model;
}

/// RANSAC's loop with another cost; the best model is fitted again to its inliers.
template <typename Cost>
ProsacResult withCost(Cost cost, const PointPairs& pairs, const ProsacOptions& options) {
  const std::vector<cv::Point2f> reference = toOpenCv(pairs.reference);
  const std::vector<cv::Point2f> target = toOpenCv(pairs.target);
  std::mt19937_64 random(options.seed);
  ProsacResult best;
  double best_cost = std::numeric_limits<double>::infinity();
  double needed = options.max_iterations;
  for (int i = 0; i < options.max_iterations && i < needed; ++i) {
    std::array<cv::Point2f, kSampleSize> from;
    std::array<cv::Point2f, kSampleSize> to;
    const auto sample = drawSample(pairs.size(), random);
    for (std::size_t k = 0; k < kSampleSize; ++k) {
      from[k] = reference[sample[k]];
      to[k] = target[sample[k]];
    }
    const cv::Mat h = cv::getPerspectiveTransform(from.data(), to.data());
    ProsacResult model = conclude(h, pairs, options.max_error);
    if (model.status != Status::ok || !model.answer.homography.allFinite()) continue;
    const double model_cost = cost(squaredErrors(model.answer.homography, pairs));
    if (model_cost >= best_cost) continue;
    best_cost = model_cost;
    best = std::move(model);
    needed = samplesNeeded(static_cast<double>(best.inliers) / static_cast<double>(pairs.size()),
                           options.confidence);
  }
  if (best.status != Status::ok) return conclude({}, pairs, options.max_error);

  return fitAgain(best, reference, target, pairs, options.max_error);
}

double area(const std::vector<Eigen::Vector2d>& points) {
  return std::max(1.0, cv::boundingRect(toOpenCv(points)).area() * 1.0);
}

using Estimate = std::function<ProsacResult(const PointPairs&, const cv::Size& reference_size,
                                            const ProsacOptions&)>;

Estimate openCv(int method) {
  return [method](const PointPairs& pairs, const cv::Size&, const ProsacOptions& options) {
    const cv::Mat h = cv::findHomography(toOpenCv(pairs.reference), toOpenCv(pairs.target), method,
                                         options.max_error, cv::noArray(), options.max_iterations,
                                         options.confidence);
    return conclude(h, pairs, options.max_error);
  };
}

const std::vector<std::pair<std::string, Estimate>>& table() {
  static const std::vector<std::pair<std::string, Estimate>> all {
    {"ransac", openCv(cv::RANSAC)},
        {"msac",
         [](const PointPairs& pairs, const cv::Size&, const ProsacOptions& options) {
           const auto cost = [&](const auto& e) { return msacCost(e, options.max_error); };
           return withCost(cost, pairs, options);
         }},
        {"mlesac",
         [](const PointPairs& pairs, const cv::Size&, const ProsacOptions& options) {
           const double outliers = area(pairs.target);
           const auto cost = [&](const auto& e) {
             return mlesacCost(e, options.max_error, outliers);
           };
           return withCost(cost, pairs, options);
         }},
        {"prosac",
         [](const PointPairs& pairs, const cv::Size& size, const ProsacOptions& options) {
           ProsacResult result;
           ProsacHomography(options).estimate(pairs, size, result);
           return result;
         }},
#if KTGP_ORB_HAVE_USAC
        {"usac", openCv(cv::USAC_DEFAULT)}, {"magsac", openCv(cv::USAC_MAGSAC)},
#endif
  };
  return all;
}

}  // namespace

std::vector<std::string> estimators() {
  std::vector<std::string> names;
  for (const auto& entry : table()) names.push_back(entry.first);
  return names;
}

ProsacResult estimateHomography(const std::string& estimator, const PointPairs& pairs,
                                const cv::Size& reference_size, const ProsacOptions& options) {
  for (const auto& [name, estimate] : table()) {
    if (name != estimator || pairs.size() < kSampleSize) continue;
    return estimate(pairs, reference_size, options);
  }
  return conclude({}, pairs, options.max_error);
}

}  // namespace ktgp_orb::evaluation
