#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "core/prosac/sampling.h"
#include "core/util/random.h"

namespace ktgp_orb::prosac {

/// Options of a run of PROSAC.
struct ProsacRules {
  int max_iterations = 2000;    ///< most samples, >= 1
  double confidence = 0.995;    ///< probability that no better model is missed, in (0, 1)
  double chance_inlier = 0.01;  ///< chance that a pair agrees with a wrong model, in (0, 1)
  int min_iterations = 0;       ///< fewest samples from the growing set, within the budget
  std::uint64_t seed = 1;
};

/// The search for the model with the least cost (Chum & Matas, "Matching with PROSAC", CVPR 2005)
/// with local optimisation (Chum, Matas & Kittler, DAGM 2003). It knows no geometry; the problem
/// supplies that:
///
///   using Model = …;                        a value
///   static constexpr std::size_t kSample;   pairs that determine models
///   std::size_t size() const;               pairs, best quality first
///   void solve(sample, visit);              calls visit(model) for each model of a sample
///   float cost(model, give_up) const;       MSAC; incomplete where it exceeds give_up
///   bool refine(widening, model);           a step over the pairs within `widening` thresholds
///   std::size_t findInliers(model, inlier) const;
///
/// Keeps its buffers.
template <typename Problem>
class ProsacSearch {
 public:
  using Model = typename Problem::Model;

  /// Draws samples until both stopping rules (ProsacStopping) are met, or the budget is used up.
  /// The problem has at least as many pairs as a sample. `initial`, if not null, is scored before
  /// the first sample. True: it or some sample gave a model.
  bool run(const ProsacRules& rules, const Model* initial, Problem& problem) {
    problem_ = &problem;
    random_ = util::Random(~rules.seed);
    best_cost_ = std::numeric_limits<float>::infinity();
    exhausted_ = true;
    stopping_.reset(kSample, problem.size(), rules.chance_inlier, rules.confidence);
    ProsacSampler sampler(kSample, problem.size(), rules.max_iterations, rules.seed);
    if (initial != nullptr && improve(*initial)) updateStopping(sampler);
    while (sampler.left() > 0) {
      sampler.draw(stopping_.terminationLength(), sample_);
      if (improveBy(sample_)) updateStopping(sampler);
      if (sampler.drawn() < std::max<double>(stopping_.samplesNeeded(), rules.min_iterations))
        continue;
      exhausted_ = false;
      break;
    }
    iterations_ = rules.max_iterations - sampler.left();
    return best_cost_ < std::numeric_limits<float>::infinity();
  }

  /// Of the last run: the model with the least cost, if one was found; the samples drawn, from the
  /// growing set and from the inliers; whether the budget was used up before the stopping rules
  /// were met.
  const Model& best() const { return best_; }
  int iterations() const { return iterations_; }
  bool exhausted() const { return exhausted_; }

 private:
  static constexpr std::size_t kSample = Problem::kSample;

  bool improveBy(const ProsacSample& sample) {
    bool improved = false;
    problem_->solve(sample, [&](const Model& model) { improved |= improve(model); });
    return improved;
  }

  /// Makes the model the best one, refined, if it is better.
  bool improve(const Model& model) {
    const float cost = problem_->cost(model, best_cost_);
    if (cost >= best_cost_) return false;
    best_ = model;
    best_cost_ = cost;
    polish();
    return true;
  }

  /// Local optimisation by steps over the inliers, with a limit that shrinks to the threshold.
  void polish() {
    Model candidate = best_;
    for (const double widening : {2.0, 1.0, 1.0}) {
      if (!problem_->refine(widening, candidate)) return;
      const float cost = problem_->cost(candidate, best_cost_);
      if (cost >= best_cost_) continue;
      best_cost_ = cost;
      best_ = candidate;
    }
  }

  /// Updates the stopping rules with the new best model. If these require more samples, first tries
  /// some from its support.
  void updateStopping(ProsacSampler& sampler) {
    findSupport();
    stopping_.update(inlier_);
    if (sampler.drawn() < stopping_.samplesNeeded() && sampleSupport(sampler)) {
      findSupport();
      stopping_.update(inlier_);
    }
  }

  void findSupport() {
    problem_->findInliers(best_, inlier_);
    support_.clear();
    for (std::size_t i = 0; i < inlier_.size(); ++i) {
      if (inlier_[i] != 0) support_.push_back(i);
    }
  }

  /// The other half of local optimisation: samples from the inliers only. A sample with one wrong
  /// pair often agrees with only a part of the right pairs, and least squares does not find the
  /// others; a sample of right pairs does. True where that gave a better model. Such samples say
  /// nothing about the other pairs, so they count towards the budget but not towards maximality.
  /// They use at most half of the remaining budget.
  bool sampleSupport(ProsacSampler& sampler) {
    constexpr int kMaxSamples = 20;
    const int samples = std::min(kMaxSamples, sampler.left() / 2);
    bool improved = false;
    sample_.resize(kSample);
    for (int i = 0; i < samples && support_.size() > kSample; ++i) {
      sampler.spend(1);
      drawDistinct(support_.size(), 0, random_, sample_);
      for (std::size_t& place : sample_) place = support_[place];
      if (!improveBy(sample_)) continue;
      improved = true;
      findSupport();
    }
    return improved;
  }

  Problem* problem_ = nullptr;  // of the run
  util::Random random_{0};      // for sampleSupport()
  Model best_{};
  float best_cost_ = 0.0F;
  int iterations_ = 0;
  bool exhausted_ = false;
  std::vector<std::uint8_t> inlier_;  // of the best, in order of quality
  std::vector<std::size_t> support_;  // indices of its inliers
  ProsacSample sample_;
  ProsacStopping stopping_;
};

}  // namespace ktgp_orb::prosac
