#include "ktgp_orb/ktgp_matcher.h"

#include <chrono>
#include <cmath>
#include <utility>

namespace ktgp_orb {
namespace {

/// Fills the statistics of one stage from the return value of `run`, which it times.
template <typename Run>
void timeStage(StageResult& stage, const char* name, std::size_t input, Run run) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  stage.output = run();
  stage.milliseconds = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  stage.name = name;
  stage.input = input;
}

Eigen::Vector2d position(const Features& features, std::int32_t index) {
  const cv::Point2f& p = features.keypoints[static_cast<std::size_t>(index)].pt;
  return {p.x, p.y};
}

void nameRefinements(const MatcherOptions& options, MatchResult& result) {
  auto& [guided, aligned] = result.refinements;
  guided = {options.guided.enabled ? "guided" : "", 0, 0, 0.0};
  aligned = {options.alignment.enabled ? "align" : "", 0, 0, 0.0};
}

/// As where there is no homography.
void clearRefinement(MatchResult& result) {
  result.guided.clear();
  std::vector<AlignedPoint> points = std::move(result.alignment.points);  // keep the buffer
  points.clear();
  result.alignment = {};
  result.alignment.points = std::move(points);
  result.homography.setZero();
  result.covariance.setZero();
  result.inliers = 0;
  result.rmse = 0.0;
}

}  // namespace

void MatchResult::surviving(Level level, std::vector<Correspondence>& out) const {
  out.clear();
  for (const Correspondence& c : correspondences) {
    if (c.level >= level) out.push_back(c);
  }
}

double MatchResult::milliseconds() const {
  double sum = 0.0;
  for (const StageResult& stage : stages) sum += stage.milliseconds;
  for (const StageResult& stage : refinements) sum += stage.milliseconds;
  return sum;
}

void MatchResult::clear(const MatcherOptions& options) {
  status = Status::no_reference;
  correspondences.clear();
  gms = {};
  prosac.status = Status::no_model;
  prosac.homography.setZero();
  prosac.covariance.setZero();
  prosac.mask.clear();
  prosac.inliers = prosac.distinct_inliers = 0;
  prosac.rmse = 0.0;
  const char* const names[] = {"knn", "tf", "gms", "prosac"};
  for (std::size_t i = 0; i < stages.size(); ++i) stages[i] = {names[i], 0, 0, 0.0};
  nameRefinements(options, *this);
  clearRefinement(*this);
}

MatcherOptions MatcherOptions::robust() {
  MatcherOptions options;
  options.mutual = true;
  options.ratio_threshold = 1.0;
  options.gms.enabled = false;
  options.guided.enabled = true;
  return options;
}

KtgpMatcher::KtgpMatcher(const MatcherOptions& options)
    : options_(options),
      knn_(options.knn),
      gms_(options.gms),
      prosac_(options.prosac),
      guided_(options.guided),
      alignment_(options.alignment) {
  std::vector<Correspondence> none;
  filterByRatio(options.ratio_threshold, none);  // refuses a bad T_w now rather than per frame
}

void KtgpMatcher::match(const Features& reference, const Features& target, MatchResult& result) {
  match(reference, target, std::nullopt, result);
}

void KtgpMatcher::match(const Features& reference, const Features& target,
                        const std::optional<Eigen::Matrix3d>& initial, MatchResult& result) {
  requireValid(reference, "reference");
  requireValid(target, "target");
  requireSameDescriptor(reference, target);
  result.descriptor = target.descriptor;
  auto& [knn, tf, gms, prosac] = result.stages;
  auto& correspondences = result.correspondences;

  timeStage(knn, "knn", target.size(), [&] {
    if (options_.mutual) {
      knn_.matchMutual(reference.descriptors, target.descriptors, correspondences);
    } else {
      knn_.match(reference.descriptors, target.descriptors, correspondences);
    }
    return correspondences.size();
  });
  timeStage(tf, "tf", knn.output, [&] {
    return filterByRatio(options_.ratio_threshold, correspondences, options_.mutual);
  });
  timeStage(gms, "gms", tf.output, [&] {
    filterByMotion(reference, target, result);
    return result.gms.kept;
  });
  timeStage(prosac, "prosac", gms.output, [&] {
    estimateHomography(reference, target, initial, result);
    return result.prosac.status == Status::ok ? result.prosac.inliers : 0;
  });

  const bool enough = reference.size() >= 2 && !target.empty();
  result.status = enough ? result.prosac.status : Status::too_few_features;
  refine(reference, target, result);
}

void KtgpMatcher::filterByMotion(const Features& reference, const Features& target,
                                 MatchResult& result) {
  if (options_.gms.enabled) {
    result.gms = gms_.filter(reference, target, result.correspondences);
    return;
  }
  result.gms = {};
  for (Correspondence& c : result.correspondences) {
    if (c.level != Level::kt) continue;
    c.level = Level::ktg;
    ++result.gms.kept;
  }
}

void KtgpMatcher::estimateHomography(const Features& reference, const Features& target,
                                     const std::optional<Eigen::Matrix3d>& initial,
                                     MatchResult& result) {
  pairs_.clear();
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktg) continue;
    pairs_.reference.push_back(position(reference, c.reference_index));
    pairs_.target.push_back(position(target, c.target_index));
    pairs_.quality.push_back(c.ratio());
  }
  prosac_.estimate(pairs_, reference.image_size, initial, result.prosac);
  if (result.prosac.status != Status::ok) return;
  std::size_t i = 0;
  for (Correspondence& c : result.correspondences) {
    if (c.level >= Level::ktg && result.prosac.mask[i++] != 0) c.level = Level::ktgp;
  }
}

void KtgpMatcher::refine(const Features& reference, const Features& target, MatchResult& result) {
  clearRefinement(result);
  nameRefinements(options_, result);
  auto& [guided, aligned] = result.refinements;
  if (result.status != Status::ok) return;
  result.homography = result.prosac.homography;
  result.covariance = result.prosac.covariance;
  const std::size_t inliers = result.prosac.inliers;
  if (options_.guided.enabled) {
    timeStage(guided, "guided", inliers, [&] {
      guided_.refine(reference, target, result.correspondences, options_.prosac.max_error,
                     result.homography, result.covariance, result.guided);
      return inliers + result.guided.size();
    });
  }
  result.inliers = inliers + result.guided.size();
  collectFinal(result);
  if (options_.alignment.enabled) {
    timeStage(aligned, "align", final_.size(), [&] {
      alignment_.align(reference, target, final_, result.homography, result.covariance,
                       result.alignment);
      return result.alignment.points.size();
    });
    result.homography = result.alignment.homography;
    result.covariance = result.alignment.covariance;
  }
  result.rmse = finalRmse(reference, target, result.homography);
}

void KtgpMatcher::collectFinal(const MatchResult& result) {
  result.surviving(Level::ktgp, final_);
  final_.insert(final_.end(), result.guided.begin(), result.guided.end());
}

double KtgpMatcher::finalRmse(const Features& reference, const Features& target,
                              const Eigen::Matrix3d& homography) const {
  double sum = 0.0;
  for (const Correspondence& c : final_) {
    const double error = reprojectionError(homography, position(reference, c.reference_index),
                                           position(target, c.target_index));
    sum += error * error;
  }
  return final_.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(final_.size()));
}

}  // namespace ktgp_orb
