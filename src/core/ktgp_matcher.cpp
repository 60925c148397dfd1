#include "ktgp_orb/ktgp_matcher.h"

#include <chrono>

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

}  // namespace

void MatchResult::surviving(Level level, std::vector<Correspondence>& out) const {
  out.clear();
  for (const Correspondence& c : correspondences) {
    if (c.level >= level) out.push_back(c);
  }
}

KtgpMatcher::KtgpMatcher(const MatcherOptions& options)
    : options_(options), knn_(options.knn), gms_(options.gms), prosac_(options.prosac) {
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
    result.gms = gms_.filter(reference, target, correspondences);
    return result.gms.kept;
  });
  timeStage(prosac, "prosac", gms.output, [&] {
    estimateHomography(reference, target, initial, result);
    return result.prosac.status == Status::ok ? result.prosac.inliers : 0;
  });

  const bool enough = reference.size() >= 2 && !target.empty();
  result.status = enough ? result.prosac.status : Status::too_few_features;
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

}  // namespace ktgp_orb
