#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "util/random.h"

namespace ktgp_orb::estimation {

/// The pairs in the order of their quality, best first; PROSAC draws them in this order. Reuses its
/// buffers from call to call.
class QualityOrder {
 public:
  /// Sorts pairs by quality; smaller values are better. Pairs of equal quality keep the order of
  /// the input.
  void sort(const std::vector<double>& quality);

  /// Returns the index, in the input of sort(), of the pair at `place` in the order of quality.
  std::size_t operator[](std::size_t place) const { return keys_[place] & kIndexMask; }
  std::size_t size() const { return keys_.size(); }

 private:
  static constexpr int kIndexBits = 32;
  static constexpr std::uint64_t kIndexMask = 0xffffffffU;

  std::vector<std::uint64_t> keys_;  // upper 32 bits: quality; lower 32 bits: index
  std::vector<std::uint64_t> sorted_;
};

/// A minimal sample: different pairs, just enough to determine a model. The entries are the places
/// of the pairs in the order of quality.
using ProsacSample = std::vector<std::size_t>;

/// Fills the entries of `sample` from index `first` on with random numbers below `end` that the
/// sample does not contain yet. At least sample.size() different numbers must be available.
void drawDistinct(std::size_t end, std::size_t first, util::Random& random, ProsacSample& sample);

/// Draws samples of m pairs from a growing set of the best pairs (Chum & Matas, CVPR 2005, section
/// 2).
///
/// The growth function gives the number of samples after which the set grows beyond the best n
/// pairs. For N pairs and a budget of T_N samples, the growth function of the paper is T_N
/// C(n,m)/C(N,m), with each step rounded up to at least one sample. With this function the set
/// never grows to the last pair within the budget, because the rounding adds N - m samples. This
/// class uses
///
///   T'(n) = 1 + r (n - m) + T_N C(n,m)/C(N,m), r = min(1, budget / 4N), T'(N) = budget:
///
/// Each new pair gets r samples; together they use at most a quarter of the budget. The rest of the
/// budget is T_N in the last term. For every N, the last sample includes the last pair.
class ProsacSampler {
 public:
  /// `sample_size`: m >= 1. `points`: N >= m. `budget`: maximum number of samples, >= 1.
  ProsacSampler(std::size_t sample_size, std::size_t points, int budget, std::uint64_t seed);

  /// Call this if `samples` samples were drawn elsewhere; they reduce the budget. The set then
  /// grows faster, so that the last sample still includes the last pair.
  void spend(int samples) { spent_ += samples; }

  /// Draws a sample of m pairs. The set of pairs from which it draws does not grow beyond the best
  /// `limit` pairs (n* in the paper).
  void draw(std::size_t limit, ProsacSample& sample);

  int drawn() const { return drawn_; }
  /// Number of samples that are left in the budget.
  int left() const { return budget_ - spent_ - drawn_; }
  std::size_t growthSetSize() const { return growth_set_size_; }

  /// Returns T'(n), the number of samples after which the set grows beyond n pairs; m <= n <= N.
  double samplesUntil(std::size_t n) const;

 private:
  double orderedSamples(std::size_t n) const;

  std::size_t sample_size_;
  std::size_t points_;
  int budget_;
  double steady_;  // r: number of samples for each new pair
  double growth_;  // T_N divided by the number of ordered samples from N pairs
  int drawn_ = 0;
  int spent_ = 0;
  std::size_t growth_set_size_;
  util::Random random_;
};

/// Decides when PROSAC may stop (Chum & Matas, CVPR 2005, section 2.2). Two rules apply to the
/// number of inliers I_n among the best n pairs, for every n:
/// - non-randomness (Eq. 8, 9): the probability that a wrong model has I_n inliers must be below
///   psi = 5 %. Each pair beyond the sample agrees with a wrong model by chance with probability
///   beta;
/// - maximality (Eq. 11, 12): after k_n = log(eta0) / log(1 - P_n) samples, the probability that a
///   better model in the best n pairs was missed is eta0. P_n: probability that a sample from the
///   best n pairs has only inliers.
/// Of all n that pass the first rule, the termination length n* is the one with the smallest k_n.
class ProsacStopping {
 public:
  /// `sample_size`: m, the number of pairs that determine a model. `points`: N >= m.
  /// `chance_inlier`: beta in (0, 1), the chance that a wrong model agrees with a pair.
  /// `confidence`: 1 - eta0 in (0, 1).
  void reset(std::size_t sample_size, std::size_t points, double chance_inlier, double confidence);

  /// Updates the rules with a new best model. `inlier`: for each pair, in order of quality, 1 if it
  /// is an inlier of this model, else 0.
  void update(const std::vector<std::uint8_t>& inlier);

  /// The termination length n*; N before the first model.
  std::size_t terminationLength() const { return termination_length_; }
  /// Number of samples that the maximality rule requires; infinite if no n passes the
  /// non-randomness rule.
  double samplesNeeded() const { return samples_needed_; }
  /// Smallest number of inliers among the best n pairs with which n passes the non-randomness rule.
  std::size_t minInliers(std::size_t n) const { return min_inliers_[n]; }

 private:
  std::size_t sample_size_ = 0;
  double log_eta_ = 0.0;
  std::size_t termination_length_ = 0;
  double samples_needed_ = 0.0;
  std::vector<std::size_t> min_inliers_;
};

struct ProsacRules {
  int max_iterations = 2000;    ///< maximum number of samples, >= 1
  double confidence = 0.995;    ///< probability that no better model is missed, in (0, 1)
  double chance_inlier = 0.01;  ///< chance that a pair agrees with a wrong model, in (0, 1)
  int min_iterations = 0;  ///< minimum number of samples from the growing set, within the budget
  std::uint64_t seed = 1;
};

/// Searches for the model with the least cost, by PROSAC (Chum & Matas, "Matching with PROSAC",
/// CVPR 2005) with local optimisation (Chum, Matas & Kittler, DAGM 2003). The class Problem knows
/// the geometry and must provide:
///
///   using Model = …;                        the type of a model, copyable
///   std::size_t sampleSize() const;         number of pairs in a sample
///   std::size_t size() const;               number of pairs, sorted by quality, best first
///   void solve(sample, visit);              calls visit(model) for each model of a sample
///   float cost(model, give_up) const;       MSAC cost; may stop once it exceeds give_up
///   bool refine(widening, model);           refits to the pairs within widening * threshold
///   std::size_t findInliers(model, inlier) const;
///
/// Reuses its buffers from call to call.
template <typename Problem>
class ProsacSearch {
 public:
  using Model = typename Problem::Model;

  /// Draws samples until both stopping rules (ProsacStopping) are met, or the budget is used up.
  /// The problem must have at least as many pairs as a sample. `initial` is scored before the first
  /// sample. Returns true if `initial` or a sample gave a model.
  bool run(const ProsacRules& rules, const std::optional<Model>& initial, Problem& problem) {
    problem_ = &problem;
    random_ = util::Random(~rules.seed);
    best_cost_ = std::numeric_limits<float>::infinity();
    exhausted_ = true;
    const std::size_t sample_size = problem.sampleSize();
    stopping_.reset(sample_size, problem.size(), rules.chance_inlier, rules.confidence);
    ProsacSampler sampler(sample_size, problem.size(), rules.max_iterations, rules.seed);
    if (initial && improve(*initial)) updateStopping(sampler);
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

  /// best(): the model with the least cost in the last run; valid only if run() returned true.
  /// iterations(): number of samples, both from the growing set and from the inliers. exhausted():
  /// true if the budget was used up before the stopping rules were met.
  const Model& best() const { return best_; }
  int iterations() const { return iterations_; }
  bool exhausted() const { return exhausted_; }

 private:
  bool improveBy(const ProsacSample& sample) {
    bool improved = false;
    problem_->solve(sample, [&](const Model& model) { improved |= improve(model); });
    return improved;
  }

  /// If the model is better than the best model, it replaces the best model and is refined.
  bool improve(const Model& model) {
    const float cost = problem_->cost(model, best_cost_);
    if (cost >= best_cost_) return false;
    best_ = model;
    best_cost_ = cost;
    polish();
    return true;
  }

  /// Local optimisation: refits the model to its inliers, first with twice the inlier threshold and
  /// then twice with the threshold itself.
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

  /// Updates the stopping rules with the new best model. If they require more samples, draws a few
  /// samples from the inliers of this model; if these improve the model, updates the rules again.
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

  /// Second part of local optimisation: draws samples from the inliers of the best model only. If
  /// the sample that gave this model has a wrong pair, the model often agrees with only some of the
  /// right pairs, and the least-squares fits of polish() do not find the others. A model from a
  /// sample of right pairs does find them. Returns true if a sample gave a better model. Samples of
  /// inliers say nothing about the other pairs, so they reduce the budget but do not count for the
  /// maximality rule. They use at most half of the budget that is left.
  bool sampleSupport(ProsacSampler& sampler) {
    constexpr int kMaxSamples = 20;
    const int samples = std::min(kMaxSamples, sampler.left() / 2);
    bool improved = false;
    sample_.resize(problem_->sampleSize());
    for (int i = 0; i < samples && support_.size() > sample_.size(); ++i) {
      sampler.spend(1);
      drawDistinct(support_.size(), 0, random_, sample_);
      for (std::size_t& place : sample_) place = support_[place];
      if (!improveBy(sample_)) continue;
      improved = true;
      findSupport();
    }
    return improved;
  }

  Problem* problem_ = nullptr;  // problem of the present run
  util::Random random_{0};      // random numbers for sampleSupport()
  Model best_{};
  float best_cost_ = 0.0F;
  int iterations_ = 0;
  bool exhausted_ = false;
  std::vector<std::uint8_t> inlier_;  // inliers of the best model, in order of quality
  std::vector<std::size_t> support_;  // places of these inliers in the order of quality
  ProsacSample sample_;
  ProsacStopping stopping_;
};

}  // namespace ktgp_orb::estimation
