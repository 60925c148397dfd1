#include "evaluation/pair_evaluation.h"

#include <algorithm>
#include <chrono>

#include "cli/files.h"

namespace ktgp_orb::tools {
namespace {

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Of every step the median of its times.
std::vector<StepResult> medianTimes(const std::vector<std::vector<StepResult>>& runs) {
  std::vector<StepResult> steps = runs.front();
  for (std::size_t i = 0; i < steps.size(); ++i) {
    std::vector<double> times;
    times.reserve(runs.size());
    for (const auto& run : runs) times.push_back(run[i].milliseconds);
    steps[i].milliseconds = median(times);
  }
  return steps;
}

}  // namespace

PairEvaluator::PairEvaluator(const OrbOptions& orb, std::vector<Method> methods, int repetitions)
    : extractor_(orb), methods_(std::move(methods)), repetitions_(repetitions) {}

PairScore PairEvaluator::evaluate(const ImagePair& pair) {
  PairScore score;
  score.pair = pair;
  try {
    evaluateImages(score);
  } catch (const FileError& error) {
    score.problem = error.what();
    score.methods.clear();
  }
  return score;
}

void PairEvaluator::evaluateImages(PairScore& score) {
  using Clock = std::chrono::steady_clock;
  const cv::Mat reference_image = readGrey(score.pair.reference);
  const cv::Mat target_image = readGrey(score.pair.target);
  const auto start = Clock::now();
  extractor_.extract(reference_image, reference_);
  extractor_.extract(target_image, target_);
  score.extraction_milliseconds =
      std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  score.reference_keypoints = reference_.size();
  score.target_keypoints = target_.size();
  const Eigen::Matrix3d& truth = score.pair.homography;
  score.detector_repeatability = detectorRepeatability(reference_, target_, truth).score();
  const Scene scene{reference_image, target_image, reference_, target_};
  for (const Method& method : methods_) {
    score.methods.push_back(evaluateMethod(method, scene, truth));
  }
}

MethodScore PairEvaluator::evaluateMethod(const Method& method, const Scene& scene,
                                          const Eigen::Matrix3d& truth) {
  std::vector<std::vector<StepResult>> runs(static_cast<std::size_t>(repetitions_));
  Matching found;
  for (auto& steps : runs) found = runMethod(method, scene, steps);
  const std::vector<Correspondence>& matches = found.matches;

  MethodScore score;
  score.method = method.name;
  score.matches = matches.size();
  score.retention = retention(matches.size(), scene.target.size());
  score.matched_share = matchedShare(matches.size(), scene.reference, scene.target);
  score.descriptor_distance = descriptorDistance(matches);
  score.displacement = displacement(scene.reference, scene.target, matches);
  const std::vector<double> errors =
      reprojectionErrors(truth, scene.reference, scene.target, matches);
  score.reprojection_error = summarize(errors);
  for (std::size_t i = 0; i < kPrecisionThresholds.size(); ++i) {
    score.precision[i] = precision(errors, kPrecisionThresholds[i]);
  }
  score.correct = countWithin(errors, kCorrectWithin);
  if (found.estimated) {
    score.corner_error = cornerError(found.homography.value_or(Eigen::Matrix3d::Zero()), truth,
                                     scene.reference.image_size);
  }
  score.steps = medianTimes(runs);
  for (const StepResult& step : score.steps) score.milliseconds += step.milliseconds;
  return score;
}

}  // namespace ktgp_orb::tools
