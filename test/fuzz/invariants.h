#pragma once

#include "input.h"

namespace ktgp_orb::fuzz {

/// Invariants of every result of the estimator.
inline void requireSound(const ProsacResult& result, const PointPairs& pairs, double threshold) {
  require(result.mask.size() == pairs.size() || result.status == Status::too_few_matches,
          "a mask entry for each pair");
  require(result.status == Status::ok || result.answer.homography.isZero(0.0), "no H unless ok");
  if (result.status != Status::ok) return;
  require(result.answer.homography.allFinite(), "H is finite");
  std::size_t inliers = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error =
        reprojectionError(result.answer.homography, pairs.reference[i], pairs.target[i]);
    require((result.mask[i] == 1) == (error < threshold), "the mask is that of H");
    inliers += result.mask[i];
  }
  require(inliers == result.inliers && inliers > 4, "as many inliers as it says");
  require(std::isfinite(result.rmse) && result.rmse < threshold, "rmse below the threshold");
}

/// Invariants of every match of two frames.
inline void requireSound(const MatchResult& result, const Features& reference,
                         const Features& target, const MatcherOptions& options) {
  const auto& all = result.correspondences;
  require(all.empty() || all.size() == target.size(), "one correspondence a target feature");
  std::size_t neighbours = 0;
  const double ratio_threshold =
      options.ratio_threshold.value_or(ratioThreshold(target.descriptor));
  static PointPairs pairs;
  pairs.clear();
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Correspondence& c = all[i];
    require(c.target_index == static_cast<std::int32_t>(i), "in target order");
    if (c.reference_index == -1) {  // no keypoint near the predicted position
      require(result.search == Search::near && c.level == Level::knn, "no match, no level");
      continue;
    }
    ++neighbours;
    require(
        c.reference_index >= 0 && static_cast<std::size_t>(c.reference_index) < reference.size(),
        "reference indices in range");
    require(c.distance >= 0 && c.distance <= 256 && c.second_distance <= 256, "distances of bits");
    require(c.level <= Level::ktgp, "levels of the four stages");
    require(c.level == Level::knn || c.ratio() < ratio_threshold, "kt passed TF");
    if (c.level < Level::ktg) continue;
    const auto& r = reference.keypoints[static_cast<std::size_t>(c.reference_index)].pt;
    pairs.reference.emplace_back(r.x, r.y);
    pairs.target.emplace_back(target.keypoints[i].pt.x, target.keypoints[i].pt.y);
  }
  const auto& stages = result.stages;
  require(stages[0].output == neighbours, "knn keeps all that have a neighbour");
  for (std::size_t s = 1; s < 4; ++s) {
    require(stages[s].input == stages[s - 1].output, "a stage begins where the one before ended");
    require(stages[s].output <= stages[s].input, "levels are nested");
    require(stages[s].output == countAtLeast(all, static_cast<Level>(s)), "levels are the counts");
  }
  if (result.status != Status::ok) {
    require(result.answer.homography.isZero(0.0) && result.inliers == 0, "no H unless ok");
    return;
  }
  require(result.answer.homography.allFinite(), "H is finite");
  require(std::isfinite(result.rmse), "rmse is finite");
  require(result.inliers == countAtLeast(all, Level::ktgp) + result.guided.size(),
          "final matches are those of level ktgp and the guided ones");
  requireSound(result.prosac, pairs, options.prosac.max_error);
  for (const Correspondence& c : result.guided) {
    require(c.level == Level::guided && c.reference_index >= 0 && c.target_index >= 0 &&
                static_cast<std::size_t>(c.reference_index) < reference.size() &&
                static_cast<std::size_t>(c.target_index) < target.size(),
            "guided matches in range");
    require(all[static_cast<std::size_t>(c.target_index)].level < Level::ktgp,
            "guided matches are additional");
  }
}

inline void requireEqual(const MatchResult& a, const MatchResult& b, const char* what) {
  require(a.status == b.status && a.inliers == b.inliers, what);
  require(a.answer.homography == b.answer.homography, what);
  require(a.correspondences.size() == b.correspondences.size(), what);
  for (std::size_t i = 0; i < a.correspondences.size(); ++i) {
    require(a.correspondences[i].level == b.correspondences[i].level, what);
    require(a.correspondences[i].reference_index == b.correspondences[i].reference_index, what);
  }
  require(a.guided.size() == b.guided.size(), what);
}

}  // namespace ktgp_orb::fuzz
