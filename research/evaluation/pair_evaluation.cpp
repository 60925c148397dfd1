#include "evaluation/pair_evaluation.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "evaluation/overlap.h"
#include "evaluation/rendering.h"
#include "evaluation/truth_points.h"
#include "files/input.h"
#include "homography/transform.h"
#include "util/milliseconds.h"

namespace ktgp_orb::evaluation {
namespace {

std::vector<StepResult> medianTimes(const std::vector<std::vector<StepResult>>& runs) {
  std::vector<StepResult> steps = runs.front();
  for (std::size_t i = 0; i < steps.size(); ++i) {
    std::vector<double> times;
    times.reserve(runs.size());
    for (const auto& run : runs) times.push_back(run[i].milliseconds);
    steps[i].milliseconds = metrics::median(times);
  }
  return steps;
}

void scoreMatches(const Matching& found, const Scene& scene, const Eigen::Matrix3d& truth,
                  MethodScore& score) {
  const Features& reference = found.own ? found.own->reference : scene.reference;
  const Features& target = found.own ? found.own->target : scene.target;
  const std::vector<Correspondence>& matches = found.matches;
  score.matches = matches.size();
  score.retention = metrics::retention(matches.size(), target.size());
  score.matched_share = metrics::matchedShare(matches.size(), reference, target);
  if (!found.own) score.descriptor_distance = metrics::descriptorDistance(matches);
  score.displacement = metrics::displacement(reference, target, matches);
  const std::vector<double> errors = metrics::reprojectionErrors(truth, reference, target, matches);
  score.reprojection_error = metrics::summarize(errors);
  for (std::size_t i = 0; i < kPrecisionThresholds.size(); ++i) {
    score.precision[i] = metrics::precision(errors, kPrecisionThresholds[i]);
  }
  score.correct = metrics::countWithin(errors, metrics::kCorrectWithin);
}

double scaleOf(const EvaluatedSize& size, const cv::Mat& image) {
  const auto [shorter, longer] = std::minmax(image.cols, image.rows);
  if (size.shortest_side > 0) return size.shortest_side / static_cast<double>(shorter);
  return size.longest_side > 0 ? std::min(1.0, size.longest_side / static_cast<double>(longer))
                               : 1.0;
}

/// Resizes the image; returns the map from original px to new px.
Eigen::Matrix3d resize(const EvaluatedSize& size, cv::Mat& image) {
  const double scale = scaleOf(size, image);
  if (scale == 1.0) return Eigen::Matrix3d::Identity();
  const cv::Size original = image.size();
  cv::resize(image, image, {}, scale, scale, scale < 1.0 ? cv::INTER_AREA : cv::INTER_LINEAR);
  const double x = image.cols / static_cast<double>(original.width);
  const double y = image.rows / static_cast<double>(original.height);
  Eigen::Matrix3d m;
  m << x, 0.0, 0.5 * (x - 1.0), 0.0, y, 0.5 * (y - 1.0), 0.0, 0.0, 1.0;
  return m;
}

/// Adapts the truth of the pair to resized images. The matrices map original px -> new px.
void resize(const Eigen::Matrix3d& reference, const Eigen::Matrix3d& target, ImagePair& pair) {
  pair.homography = target * pair.homography * reference.inverse();
  for (AnnotatedPoint& p : pair.points) {
    p.reference = (reference * p.reference.homogeneous()).head<2>();
    p.target = (target * p.target.homogeneous()).head<2>();
  }
}

/// Throws FileError if the truth cannot be that of these images.
void requireOverlap(const ImagePair& pair, const cv::Size& reference, const cv::Size& target) {
  constexpr int kSteps = 50;
  for (int i = 0; i < kSteps * kSteps; ++i) {
    const int row = i / kSteps;
    const Eigen::Vector2d at =
        homography::project(pair.homography, {(reference.width - 1.0) * (i % kSteps) / (kSteps - 1),
                                              (reference.height - 1.0) * row / (kSteps - 1)});
    if (isInside(target, at.x(), at.y())) return;
  }
  throw files::FileError(pair.reference, "the true homography maps no point of it into " +
                                             pair.target + "; expected that from A to B, px");
}

CornerConsistency cornerConsistency(const UncertainHomography& found, const Eigen::Matrix3d& truth,
                                    double truth_deviation, const cv::Size& size) {
  CornerConsistency result;
  double predicted2 = 0.0;
  double error2 = 0.0;
  const auto corners = homography::imageCorners(size, {});
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector2d error =
        homography::project(found.homography, corners[i]) - homography::project(truth, corners[i]);
    const auto jacobian = homography::jacobianByEntries(found.homography, corners[i]);
    const Eigen::Matrix2d of_truth =
        Eigen::Matrix2d::Identity() * truth_deviation * truth_deviation;
    const Eigen::Matrix2d spread = jacobian * found.covariance * jacobian.transpose() + of_truth;
    predicted2 += spread.trace() / 4.0;
    error2 += error.squaredNorm() / 4.0;
    result.normalised[i] = error.dot(spread.inverse() * error);
  }
  result.predicted = std::sqrt(predicted2);
  result.ratio = std::sqrt(error2) / result.predicted;
  return result;
}

void scoreHomography(const Matching& found, const Scene& scene, const Eigen::Matrix3d& truth,
                     const std::vector<AnnotatedPoint>& points, double truth_deviation,
                     MethodScore& score) {
  constexpr double kAnnotated = 1.0;  // px, accuracy of annotated points
  if (!found.estimated) return;
  score.found = found.answer.has_value();
  const UncertainHomography estimate = found.answer.value_or(UncertainHomography());
  score.corner_error =
      metrics::cornerError(estimate.homography, truth, scene.reference_image.size());
  if (!score.found) return;
  if (!points.empty()) score.corner_error = meanTransferError(estimate.homography, points);
  if (estimate.covariance.allFinite()) {
    if (points.empty()) {
      score.consistency =
          cornerConsistency(estimate, truth, truth_deviation, scene.reference_image.size());
    } else {
      score.within_covariance = isWithinCovariance(estimate, points, kAnnotated);
    }
  }
  score.zncc = overlapCorrelation(scene.reference_image, scene.target_image, estimate.homography);
}

}  // namespace

PairEvaluator::PairEvaluator(const OrbOptions& orb, std::vector<Method> methods, int repetitions,
                             const EvaluatedSize& size, double truth_deviation)
    : extractor_(withImages(orb)),
      methods_(std::move(methods)),
      repetitions_(repetitions),
      size_(size),
      truth_deviation_(truth_deviation) {}

PairScore PairEvaluator::evaluate(const ImagePair& pair) {
  PairScore score;
  score.pair = pair;
  try {
    cv::Mat reference = files::readGrey(pair.reference);
    if (pair.warp) {
      const WarpedImages images = renderWarp(reference, *pair.warp);
      evaluateImages(images.reference, images.target, score);
    } else {
      cv::Mat target = files::readGrey(pair.target);
      const Eigen::Matrix3d of_reference = resize(size_, reference);
      resize(of_reference, resize(size_, target), score.pair);
      requireOverlap(score.pair, reference.size(), target.size());
      evaluateImages(reference, target, score);
    }
  } catch (const files::FileError& error) {
    score.problem = error.what();
    score.methods.clear();
  }
  return score;
}

void PairEvaluator::evaluateImages(const cv::Mat& reference_image, const cv::Mat& target_image,
                                   PairScore& score) {
  score.extraction_milliseconds = extract(reference_image, target_image);
  score.reference_keypoints = reference_.size();
  score.target_keypoints = target_.size();
  const Eigen::Matrix3d& truth = score.pair.homography;
  score.detector_repeatability = metrics::detectorRepeatability(reference_, target_, truth).score();
  const Scene scene{reference_image, target_image, reference_, target_};
  for (const Method& method : methods_) {
    score.methods.push_back(
        evaluateMethod(method, scene, truth, score.pair.points, score.extraction_milliseconds));
  }
}

double PairEvaluator::extract(const cv::Mat& reference_image, const cv::Mat& target_image) {
  using Clock = std::chrono::steady_clock;
  std::vector<double> times;
  for (int i = 0; i < repetitions_; ++i) {
    const auto start = Clock::now();
    extractor_.extract(reference_image, reference_);
    extractor_.extract(target_image, target_);
    times.push_back(util::millisecondsSince(start));
  }
  return metrics::median(times);
}

MethodScore PairEvaluator::evaluateMethod(const Method& method, const Scene& scene,
                                          const Eigen::Matrix3d& truth,
                                          const std::vector<AnnotatedPoint>& points,
                                          double extraction_milliseconds) {
  std::vector<std::vector<StepResult>> runs(static_cast<std::size_t>(repetitions_));
  Matching found;
  MethodScore score;
  score.method = method.name;
  try {
    for (auto& steps : runs) found = runMethod(method, scene, steps);
  } catch (const std::exception& error) {
    const auto* of_opencv = dynamic_cast<const cv::Exception*>(&error);
    score.problem = of_opencv != nullptr ? "OpenCV: " + of_opencv->err : error.what();
    score.corner_error = std::numeric_limits<double>::infinity();  // counts as no homography
    return score;
  }
  scoreMatches(found, scene, truth, score);
  scoreHomography(found, scene, truth, points, truth_deviation_, score);
  score.steps = medianTimes(runs);
  for (const StepResult& step : score.steps) score.milliseconds += step.milliseconds;
  score.total_milliseconds = score.milliseconds + (found.own ? 0.0 : extraction_milliseconds);
  return score;
}

}  // namespace ktgp_orb::evaluation
