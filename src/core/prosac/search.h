#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/homography/refinement.h"
#include "core/prosac/points.h"
#include "core/prosac/sampler.h"
#include "core/prosac/stopping.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// The search of PROSAC for the homography with the least MSAC cost. Keeps its buffers.
class ProsacSearch {
 public:
  /// Draws samples until both stopping rules are content or the budget is used up. Fills in
  /// `result` how that went; false where no sample gave a homography. `points`: at least four.
  /// `initial`, if any, is scored before the first sample; between normalised coordinates.
  bool run(const ProsacPoints& points, const ProsacOptions& options, double chance_inlier,
           const std::optional<Eigen::Matrix3d>& initial, ProsacResult& result);

  /// The best homography, between normalised coordinates.
  const Eigen::Matrix3d& best() const { return best_; }

 private:
  bool solve(const ProsacSample& sample, Eigen::Matrix3d& homography) const;
  bool improve(const ProsacSample& sample);
  bool improve(const Eigen::Matrix3d& model);
  void reconsiderStopping(int drawn);
  void polish();
  void findSupport();
  int sampleSupport();

  const ProsacPoints* points_ = nullptr;
  Random random_{0};  // for sampleSupport()
  Eigen::Matrix3d best_;
  float best_cost_ = 0.0F;
  std::vector<std::uint8_t> inlier_;  // of the best, in order of quality
  std::vector<std::size_t> support_;  // places of its inliers
  HomographyRefinement refinement_;
  ProsacStopping stopping_;
};

}  // namespace ktgp_orb
