#include "evaluation/methods.h"

#include <chrono>

#include "util/milliseconds.h"

namespace ktgp_orb::evaluation {
namespace {

/// The preset `robust` with the threads, budget, seed and alignment of `options`.
MatcherOptions robust(const MatcherOptions& options) {
  MatcherOptions preset = MatcherOptions::robust();
  preset.knn = options.knn;
  preset.prosac = options.prosac;
  preset.growth.seeds = options.growth.seeds;
  preset.guided.radius = options.guided.radius;
  preset.alignment = options.alignment;
  return preset;
}

OrbOptions withTeblid(OrbOptions options) {
  options.descriptor = DescriptorKind::teblid;
  return options;
}

/// Together with growth, these options find the most hard pairs (doc/tuning.md): more and weaker
/// corners, and descriptors that tolerate changes of light.
OrbOptions forHardPairs(OrbOptions options) {
  options.descriptor = DescriptorKind::teblid;
  options.max_features = 3000;
  options.fast_threshold = 10;
  return options;
}

MatcherOptions withoutGrowth(MatcherOptions options) {
  options.growth.enabled = false;
  return options;
}

}  // namespace

std::vector<Method> allMethods(const PipelineOptions& pipeline, const std::string& estimator) {
  const MatcherOptions& options = pipeline.matcher;
  GmsOptions motion = options.gms;
  motion.enabled = true;  // the method's name decides about GMS
  GmsOptions rotating = motion;
  rotating.rotation = rotating.scale = true;
  const double t_w = options.ratio_threshold.value_or(ratioThreshold(pipeline.orb.descriptor));
  const auto knn = [&] { return nearest(options.knn); };
  const auto both_ways = [&] { return bidirectional(options.knn); };
  const auto model = [&](const std::string& usual) {
    return homography(estimator.empty() ? usual : estimator, options.prosac);
  };

  // Thresholds that the papers do not give.
  constexpr int kDistance = 30;     // bits; as in many ORB programs
  constexpr double kCosine = 0.85;  // about 38 bits of 256
  constexpr double kNorm = 0.1;
  constexpr double kGrey = 0.5;  // standard deviations

  std::vector<Method> methods{
      {"ORB", "nearest neighbour with cross-check", {knn(), both_ways()}},
      {"ORB+RANSAC", "nearest neighbour, RANSAC", {knn(), model("ransac")}},
      {"KT", "KNN, ratio filter", {knn(), ratio(t_w)}},
      {"KTG", "KT, GMS", {knn(), ratio(t_w), gms(motion)}},
      {"KTGP",
       "KTG, PROSAC: the paper's method",
       {knn(), ratio(t_w), gms(motion), model("prosac")}},
      {"KTGP+ALIGN",
       "KTGP, sub-pixel alignment",
       {knn(), ratio(t_w), gms(motion), model("prosac"), align(options)}},
      {"KTG-RS", "KTG with rotation and scale", {knn(), ratio(t_w), gms(rotating)}},
      {"KTGP-RS",
       "KTGP with rotation and scale",
       {knn(), ratio(t_w), gms(rotating), model("prosac")}},
      {"MUTUAL",
       "mutual nearest neighbours, PROSAC; no ratio, no GMS",
       {mutualNearest(options.knn), model("prosac")}},
      {"MUTUAL+ALIGN",
       "MUTUAL, sub-pixel alignment",
       {mutualNearest(options.knn), model("prosac"), align(options)}},
      {"ROBUST",
       "the preset: MUTUAL, growth where PROSAC finds nothing, a guided round, alignment",
       {matcher(robust(options))}},
      {"ROBUST-TEBLID",
       "the same over TEBLID descriptors",
       {extract(withTeblid(pipeline.orb)), matcher(robust(options))}},
      {"ROBUST-GROWTH", "ROBUST without the growth", {matcher(withoutGrowth(robust(options)))}},
      {"HARD",
       "ROBUST over 3000 TEBLID features, FAST threshold 10",
       {extract(forHardPairs(pipeline.orb)), matcher(robust(options))}},
      {"HARD-VIEWS",
       "HARD, with 12 simulated views of the reference",
       {extract(forHardPairs(pipeline.orb)), simulate(forHardPairs(pipeline.orb), 13),
        matcher(robust(options))}},
      {"GMS", "nearest neighbour, GMS (Bian 2017)", {knn(), gms(motion)}},
      {"GMS-5", "GMS over five cells (Chen 2018)", {knn(), gmsOver(cross(), options.gms)}},
      {"GMS5x5", "GMS over 5x5 cells", {knn(), gmsOver(square(2), options.gms)}},
      {"GMS-RANSAC", "GMS, RANSAC (Zhu 2019)", {knn(), gms(motion), model("ransac")}},
      {"MP-ORB",
       "KNN, ratio, both directions, cosine, PROSAC (Ye)",
       {knn(), ratio(t_w), both_ways(), cosineSimilarity(kCosine), model("prosac")}},
      {"Sun2016",
       "KNN, threshold, descriptor norm, RANSAC (Sun)",
       {knn(), distanceThreshold(kDistance), similarNorm(kNorm), model("ransac")}},
      {"KTBER",
       "KNN, ratio, both directions, Euclidean, grey level, RANSAC (Sun)",
       {knn(), ratio(t_w), both_ways(), euclideanDistance(), greyLevel(kGrey), model("ransac")}},
      {"KRCR",
       "KNN, threshold, ratio, cosine, RANSAC (Sun)",
       {knn(), distanceThreshold(kDistance), ratio(t_w), cosineSimilarity(kCosine),
        model("ransac")}},
  };
  for (const std::string& name : estimators()) {
    if (name == "prosac") continue;
    methods.push_back(
        {"KTG+" + name, "KTG, " + name, {knn(), ratio(t_w), gms(motion), model(name)}});
  }
  return methods;
}

Matching runMethod(const Method& method, const Scene& scene, std::vector<StepResult>& steps) {
  using Clock = std::chrono::steady_clock;
  Matching matching;
  steps.clear();
  for (const Step& step : method.steps) {
    const auto start = Clock::now();
    step.run(scene, matching);
    steps.push_back({step.name, matching.matches.size(), util::millisecondsSince(start)});
  }
  return matching;
}

}  // namespace ktgp_orb::evaluation
