#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "core/prosac/sampler.h"
#include "core/prosac/stopping.h"
#include "core/util/random.h"

namespace ktgp_orb {

/// What a run of PROSAC goes by.
struct ProsacRules {
  int max_iterations = 2000;    ///< samples solved at most, >= 1
  double confidence = 0.995;    ///< wanted probability that no better model is missed, in (0, 1)
  double chance_inlier = 0.01;  ///< that a pair agrees with a wrong model by chance, in (0, 1)
  std::uint64_t seed = 1;
};

/// How a run went.
struct ProsacRun {
  bool found = false;               ///< some sample gave a model
  bool exhausted = true;            ///< the budget ended it, not the stopping rules
  int iterations = 0;               ///< samples drawn: from the growing set, and from the inliers
  int local_optimisations = 0;      ///< times a new best model was polished
  std::size_t growth_set_size = 0;  ///< best pairs sampled from at the end, n of PROSAC
};

/// The search for the model with the least cost (Chum & Matas, "Matching with PROSAC", CVPR 2005)
/// with local optimisation (Chum, Matas & Kittler, DAGM 2003). It knows of the model no more than
/// that an estimator solves for it, scores it and refines it:
///
///   struct Estimator {
///     using Model = …;
///     static constexpr std::size_t kSampleSize = …;  // pairs that determine a model
///     std::size_t size() const;                      // pairs; place 0 has the best quality
///     // The model through a sample; false where the sample is degenerate.
///     bool solve(const ProsacSample& sample, Model& model);
///     // Its cost, less is better; a cost above `give_up` need not be complete.
///     float score(const Model& model, float give_up) const;
///     // Whether each pair agrees with it, 0 or 1.
///     void score(const Model& model, std::vector<std::uint8_t>& inlier) const;
///     // A step towards the optimum over the pairs within `widening` times the inlier threshold;
///     // false where these are no more than a sample or do not determine it.
///     bool refine(double widening, Model& model);
///   };
///
/// Keeps its buffers.
template <typename Estimator>
class Prosac {
 public:
  using Model = typename Estimator::Model;

  /// Draws samples until both stopping rules are content or the budget is used up. `estimator`
  /// holds at least a sample of pairs. `initial`, if not null, is scored before the first sample.
  ProsacRun run(const ProsacRules& rules, const Model* initial, Estimator& estimator);

  /// The model with the least cost, where one was found.
  const Model& best() const { return best_; }

 private:
  static constexpr std::size_t kSampleSize = Estimator::kSampleSize;
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();

  bool improve(const ProsacSample& sample, Estimator& estimator);
  bool improve(const Model& model, Estimator& estimator);
  void polish(Estimator& estimator);
  void updateStopping(ProsacSampler& sampler, Estimator& estimator);
  void findSupport(const Estimator& estimator);
  bool sampleSupport(ProsacSampler& sampler, Estimator& estimator);

  int local_optimisations_ = 0;
  util::Random random_{0};  // for sampleSupport()
  Model best_;
  float best_cost_ = kInfinity;
  std::vector<std::uint8_t> inlier_;  // of the best, in order of quality
  std::vector<std::size_t> support_;  // places of its inliers
  ProsacSample sample_;
  ProsacStopping stopping_;
};

template <typename Estimator>
ProsacRun Prosac<Estimator>::run(const ProsacRules& rules, const Model* initial,
                                 Estimator& estimator) {
  ProsacRun run;
  local_optimisations_ = 0;
  random_ = util::Random(~rules.seed);
  best_cost_ = kInfinity;
  stopping_.reset(kSampleSize, estimator.size(), rules.chance_inlier, rules.confidence);
  ProsacSampler sampler(kSampleSize, estimator.size(), rules.max_iterations, rules.seed);
  if (initial != nullptr && improve(*initial, estimator)) updateStopping(sampler, estimator);
  while (sampler.left() > 0) {
    sampler.draw(stopping_.terminationLength(), sample_);
    if (improve(sample_, estimator)) updateStopping(sampler, estimator);
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

template <typename Estimator>
bool Prosac<Estimator>::improve(const ProsacSample& sample, Estimator& estimator) {
  Model model;
  return estimator.solve(sample, model) && improve(model, estimator);
}

/// Takes the model for the best, polished, if it is better.
template <typename Estimator>
bool Prosac<Estimator>::improve(const Model& model, Estimator& estimator) {
  const float cost = estimator.score(model, best_cost_);
  if (cost >= best_cost_) return false;
  best_ = model;
  best_cost_ = cost;
  polish(estimator);
  return true;
}

/// Local optimisation by steps over the inliers, from a wide limit down to the threshold.
template <typename Estimator>
void Prosac<Estimator>::polish(Estimator& estimator) {
  ++local_optimisations_;
  Model candidate = best_;
  for (double widening : {2.0, 1.0, 1.0}) {
    if (!estimator.refine(widening, candidate)) return;
    const float cost = estimator.score(candidate, best_cost_);
    if (cost >= best_cost_) continue;
    best_cost_ = cost;
    best_ = candidate;
  }
}

/// Tells the stopping rules of the new best model; where they want more samples, tries some from
/// its support first.
template <typename Estimator>
void Prosac<Estimator>::updateStopping(ProsacSampler& sampler, Estimator& estimator) {
  findSupport(estimator);
  stopping_.update(inlier_);
  if (sampler.drawn() < stopping_.samplesNeeded() && sampleSupport(sampler, estimator)) {
    findSupport(estimator);
    stopping_.update(inlier_);
  }
}

template <typename Estimator>
void Prosac<Estimator>::findSupport(const Estimator& estimator) {
  estimator.score(best_, inlier_);
  support_.clear();
  for (std::size_t i = 0; i < inlier_.size(); ++i) {
    if (inlier_[i] != 0) support_.push_back(i);
  }
}

/// The other half of local optimisation: samples from the inliers alone. A sample with one wrong
/// pair often agrees with a part of the right ones, from where least squares does not lead out; a
/// sample of those does. True where that gave a better model. Samples like these say nothing of
/// what the other pairs hold, so they count towards the budget but not towards maximality; at most
/// half of what is left goes into them.
template <typename Estimator>
bool Prosac<Estimator>::sampleSupport(ProsacSampler& sampler, Estimator& estimator) {
  constexpr int kMaxSamples = 20;
  const int samples = std::min(kMaxSamples, sampler.left() / 2);
  bool improved = false;
  sample_.resize(kSampleSize);
  for (int i = 0; i < samples && support_.size() > kSampleSize; ++i) {
    sampler.spend(1);
    drawDistinct(support_.size(), 0, random_, sample_);
    for (std::size_t& place : sample_) place = support_[place];
    if (!improve(sample_, estimator)) continue;
    improved = true;
    findSupport(estimator);
  }
  return improved;
}

}  // namespace ktgp_orb
