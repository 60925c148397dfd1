#include "core/prosac/search.h"

#include <limits>

#include "core/homography/score.h"
#include "core/homography/solver.h"

namespace ktgp_orb {
namespace {

constexpr std::size_t kSampleSize = 4;

}  // namespace

bool ProsacSearch::run(const ProsacPoints& points, const ProsacOptions& options,
                       double chance_inlier, const std::optional<Eigen::Matrix3d>& initial,
                       ProsacResult& result) {
  points_ = &points;
  random_ = Random(~options.seed);
  best_cost_ = std::numeric_limits<float>::infinity();
  stopping_.reset(points.size(), chance_inlier, options.confidence);
  ProsacSampler sampler(points.size(), options.max_iterations, options.seed);
  result.stop = ProsacStop::max_iterations;
  if (initial && improve(*initial)) {
    ++result.local_optimisations;
    reconsiderStopping(sampler.drawn());
  }
  while (sampler.drawn() < options.max_iterations) {
    if (improve(sampler.draw(stopping_.terminationLength()))) {
      ++result.local_optimisations;
      reconsiderStopping(sampler.drawn());
    }
    if (sampler.drawn() < stopping_.samplesNeeded()) continue;
    result.stop = ProsacStop::maximality;
    break;
  }
  result.iterations = sampler.drawn();
  result.growth_set_size = sampler.growthSetSize();
  return best_cost_ < std::numeric_limits<float>::infinity();
}

bool ProsacSearch::solve(const ProsacSample& sample, Eigen::Matrix3d& homography) const {
  const PointArrays<double>& p = points_->refinement;
  FourPoints from;
  FourPoints to;
  for (std::size_t i = 0; i < kSampleSize; ++i) {
    from[i] = {p.x[sample[i]], p.y[sample[i]]};
    to[i] = {p.u[sample[i]], p.v[sample[i]]};
  }
  return solveFourPoints(from, to, points_->min_reference_area, points_->min_target_area,
                         homography);
}

/// Takes the homography through the sample for the best, polished, if it is better.
bool ProsacSearch::improve(const ProsacSample& sample) {
  Eigen::Matrix3d model;
  return solve(sample, model) && improve(model);
}

bool ProsacSearch::improve(const Eigen::Matrix3d& model) {
  const float cost = msacCost(points_->scoring, model, points_->limit, best_cost_);
  if (cost >= best_cost_) return false;
  best_ = model;
  best_cost_ = cost;
  polish();
  return true;
}

/// Local optimisation (Chum, Matas & Kittler, DAGM 2003) by steps over the inliers, from a wide
/// limit down to the threshold.
void ProsacSearch::polish() {
  constexpr std::size_t kEnough = 200;  // inliers, the best by quality; more would not find more
  Eigen::Matrix3d candidate = best_;
  for (double widening : {2.0, 1.0, 1.0}) {
    const double limit = widening * points_->limit;
    findInliers(points_->scoring, candidate, limit, inlier_);
    if (refinement_.select(points_->refinement, inlier_, kEnough) <= kSampleSize) return;
    if (!refinement_.step(limit / 3.0, candidate)) return;
    const float cost = msacCost(points_->scoring, candidate, points_->limit, best_cost_);
    if (cost >= best_cost_) continue;
    best_cost_ = cost;
    best_ = candidate;
  }
}

/// Tells the stopping rules of the new best model; where they want more samples, first tries some
/// from its support.
void ProsacSearch::reconsiderStopping(int drawn) {
  findSupport();
  stopping_.update(inlier_);
  if (drawn < stopping_.samplesNeeded() && sampleSupport() > 0) {
    findSupport();
    stopping_.update(inlier_);
  }
}

void ProsacSearch::findSupport() {
  findInliers(points_->scoring, best_, points_->limit, inlier_);
  support_.clear();
  for (std::size_t i = 0; i < inlier_.size(); ++i) {
    if (inlier_[i] != 0) support_.push_back(i);
  }
}

/// The other half of local optimisation: samples from the inliers alone. A sample with one wrong
/// pair often agrees with a part of the right ones, from where least squares does not lead out;
/// four of those do. Returns how often that gave a better homography.
int ProsacSearch::sampleSupport() {
  constexpr int kSamples = 20;
  int improvements = 0;
  for (int i = 0; i < kSamples && support_.size() > kSampleSize; ++i) {
    ProsacSample sample{};
    drawDistinct(support_.size(), 0, random_, sample);
    for (std::size_t& place : sample) place = support_[place];
    if (!improve(sample)) continue;
    ++improvements;
    findSupport();
  }
  return improvements;
}

}  // namespace ktgp_orb
