#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/homography/m_estimator.h"
#include "core/homography/point_pairs.h"
#include "core/homography/sampler.h"
#include "core/homography/stopping.h"
#include "core/util/random.h"

namespace ktgp_orb::homography {

/// Options of a run of PROSAC.
struct ProsacRules {
  int max_iterations = 2000;    ///< most samples, >= 1
  double confidence = 0.995;    ///< probability that no better H is missed, in (0, 1)
  double chance_inlier = 0.01;  ///< chance that a pair agrees with a wrong H, in (0, 1)
  std::uint64_t seed = 1;
};

/// Details of a run.
struct ProsacRun {
  bool found = false;               ///< some sample gave a homography
  bool exhausted = true;            ///< the budget was used up before the stopping rules were met
  int iterations = 0;               ///< samples drawn: from the growing set, and from the inliers
  int local_optimisations = 0;      ///< times a new best homography was refined
  std::size_t growth_set_size = 0;  ///< number n of best pairs sampled from at the end
};

/// The search for the homography with the least cost (Chum & Matas, "Matching with PROSAC", CVPR
/// 2005) with local optimisation (Chum, Matas & Kittler, DAGM 2003). The cost is MSAC's
/// (core/homography/score.h). All homographies are between normalised coordinates. Keeps its
/// buffers.
class ProsacSearch {
 public:
  /// Draws samples until both stopping rules (core/homography/stopping.h) are met, or the budget is
  /// used up. `pairs`: at least four, best quality first. `initial`, if not null, is scored before
  /// the first sample.
  ProsacRun run(const ProsacRules& rules, const Eigen::Matrix3d* initial,
                const NormalisedPairs& pairs);

  /// The homography with the least cost, if one was found.
  const Eigen::Matrix3d& best() const { return best_; }

 private:
  bool improve(const ProsacSample& sample);
  bool improve(const Eigen::Matrix3d& homography);
  void polish();
  bool refine(double widening, Eigen::Matrix3d& homography);
  void updateStopping(ProsacSampler& sampler);
  void findSupport();
  bool sampleSupport(ProsacSampler& sampler);

  const NormalisedPairs* pairs_ = nullptr;  // of the run
  int local_optimisations_ = 0;
  util::Random random_{0};  // for sampleSupport()
  Eigen::Matrix3d best_ = Eigen::Matrix3d::Zero();
  float best_cost_ = 0.0F;
  std::vector<std::uint8_t> inlier_;  // of the best, in order of quality
  std::vector<std::size_t> support_;  // indices of its inliers
  std::vector<std::uint8_t> near_;    // pairs used by refine()
  ProsacSample sample_;
  ProsacStopping stopping_;
  MEstimator estimator_;
};

}  // namespace ktgp_orb::homography
