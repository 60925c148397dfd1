#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <vector>

#include "core/homography/problem.h"
#include "core/homography/refinement.h"
#include "core/homography/solver.h"
#include "core/prosac/sampler.h"

namespace ktgp_orb {

/// What Prosac<> needs to know of a homography. The models are between normalised coordinates.
class HomographyEstimator {
 public:
  using Model = Eigen::Matrix3d;
  static constexpr std::size_t kSampleSize = std::tuple_size<FourPoints>::value;

  /// The pairs, best quality first; filled in by the caller.
  HomographyProblem problem;

  std::size_t size() const { return problem.size(); }

  bool solve(const ProsacSample& sample, Eigen::Matrix3d& homography) const;
  float score(const Eigen::Matrix3d& homography, float give_up) const;
  void score(const Eigen::Matrix3d& homography, std::vector<std::uint8_t>& inlier) const;
  bool refine(double widening, Eigen::Matrix3d& homography);

 private:
  HomographyRefinement refinement_;
  std::vector<std::uint8_t> near_;  // pairs that refine() works on
};

}  // namespace ktgp_orb
