#include "core/homography/prosac.h"

#include <algorithm>
#include <limits>
#include <tuple>

#include "core/homography/four_point.h"
#include "core/homography/score.h"

namespace ktgp_orb::homography {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr std::size_t kSampleSize = std::tuple_size<FourPoints>::value;

}  // namespace

ProsacRun ProsacSearch::run(const ProsacRules& rules, const Eigen::Matrix3d* initial,
                            const NormalisedPairs& pairs) {
  ProsacRun run;
  pairs_ = &pairs;
  local_optimisations_ = 0;
  random_ = util::Random(~rules.seed);
  best_cost_ = kInfinity;
  stopping_.reset(kSampleSize, pairs.size(), rules.chance_inlier, rules.confidence);
  ProsacSampler sampler(kSampleSize, pairs.size(), rules.max_iterations, rules.seed);
  if (initial != nullptr && improve(*initial)) updateStopping(sampler);
  while (sampler.left() > 0) {
    sampler.draw(stopping_.terminationLength(), sample_);
    if (improve(sample_)) updateStopping(sampler);
    if (sampler.drawn() < stopping_.samplesNeeded()) continue;
    run.exhausted = false;
    break;
  }
  run.found = best_cost_ < kInfinity;
  run.iterations = rules.max_iterations - sampler.left();
  run.local_optimisations = local_optimisations_;
  run.growth_set_size = sampler.growthSetSize();
  return run;
}

bool ProsacSearch::improve(const ProsacSample& sample) {
  const PointArrays<double>& p = pairs_->refinement;
  FourPoints from;
  FourPoints to;
  for (std::size_t i = 0; i < kSampleSize; ++i) {
    from[i] = {p.x[sample[i]], p.y[sample[i]]};
    to[i] = {p.u[sample[i]], p.v[sample[i]]};
  }
  Eigen::Matrix3d homography;
  return solveFourPoints(from, to, pairs_->min_reference_area, pairs_->min_target_area,
                         homography) &&
         improve(homography);
}

/// Makes the homography the best one, refined, if it is better.
bool ProsacSearch::improve(const Eigen::Matrix3d& homography) {
  const float cost = msacCost(pairs_->scoring, homography, pairs_->limit, best_cost_);
  if (cost >= best_cost_) return false;
  best_ = homography;
  best_cost_ = cost;
  polish();
  return true;
}

/// Local optimisation by steps over the inliers, with a limit that shrinks to the threshold.
void ProsacSearch::polish() {
  ++local_optimisations_;
  Eigen::Matrix3d candidate = best_;
  for (double widening : {2.0, 1.0, 1.0}) {
    if (!refine(widening, candidate)) return;
    const float cost = msacCost(pairs_->scoring, candidate, pairs_->limit, best_cost_);
    if (cost >= best_cost_) continue;
    best_cost_ = cost;
    best_ = candidate;
  }
}

/// A step towards the optimum over the pairs within `widening` thresholds; false where these are
/// not more than a sample, or do not determine H.
bool ProsacSearch::refine(double widening, Eigen::Matrix3d& homography) {
  constexpr std::size_t kEnough = 200;  // best pairs; more would not find more
  constexpr double kScales = 3.0;       // of the errors within the limit
  const double limit = widening * pairs_->limit;
  findInliers(pairs_->scoring, homography, limit, near_);
  if (estimator_.select(pairs_->refinement, near_, kEnough) <= kSampleSize) return false;
  return estimator_.step(limit / kScales, homography);
}

/// Updates the stopping rules with the new best homography. If these require more samples, first
/// tries some from its support.
void ProsacSearch::updateStopping(ProsacSampler& sampler) {
  findSupport();
  stopping_.update(inlier_);
  if (sampler.drawn() < stopping_.samplesNeeded() && sampleSupport(sampler)) {
    findSupport();
    stopping_.update(inlier_);
  }
}

void ProsacSearch::findSupport() {
  findInliers(pairs_->scoring, best_, pairs_->limit, inlier_);
  support_.clear();
  for (std::size_t i = 0; i < inlier_.size(); ++i) {
    if (inlier_[i] != 0) support_.push_back(i);
  }
}

/// The other half of local optimisation: samples from the inliers only. A sample with one wrong
/// pair often agrees with only a part of the right pairs, and least squares does not find the
/// others; a sample of right pairs does. True where that gave a better homography. Such samples say
/// nothing about the other pairs, so they count towards the budget but not towards maximality. They
/// use at most half of the remaining budget.
bool ProsacSearch::sampleSupport(ProsacSampler& sampler) {
  constexpr int kMaxSamples = 20;
  const int samples = std::min(kMaxSamples, sampler.left() / 2);
  bool improved = false;
  sample_.resize(kSampleSize);
  for (int i = 0; i < samples && support_.size() > kSampleSize; ++i) {
    sampler.spend(1);
    drawDistinct(support_.size(), 0, random_, sample_);
    for (std::size_t& place : sample_) place = support_[place];
    if (!improve(sample_)) continue;
    improved = true;
    findSupport();
  }
  return improved;
}

}  // namespace ktgp_orb::homography
