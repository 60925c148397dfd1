#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <vector>

#include "core/homography/m_estimator.h"
#include "core/homography/point_pairs.h"
#include "core/homography/transform.h"
#include "core/prosac/sampling.h"

namespace ktgp_orb::homography {

/// The homography that maps four reference points to four target points, in closed form.
/// Returns false, before solving, where it cannot be the view of a plane from one side: a triangle
/// of three of the points is flat (doubled area below `min_area`: collinear or duplicate points) or
/// has opposite orientations in the two images. On success H x has a positive third coordinate at
/// the four points.
bool solveFourPoints(const FourPoints& reference, const FourPoints& target,
                     double min_reference_area, double min_target_area,
                     Eigen::Matrix3d& homography);

/// MSAC cost (Torr & Zisserman, CVIU 2000): sum over the pairs of min(e², limit²), with e the
/// reprojection error in the target. Stops as soon as the sum exceeds `give_up` and returns the
/// partial sum, so a cost below `give_up` is complete.
float msacCost(const PointArrays<float>& points, const Eigen::Matrix3d& homography, double limit,
               float give_up);

/// inlier[i] = 1 where e < limit, else 0; one entry per pair. Returns the number of ones.
std::size_t findInliers(const PointArrays<float>& points, const Eigen::Matrix3d& homography,
                        double limit, std::vector<std::uint8_t>& inlier);

/// A homography between normalised coordinates as prosac::ProsacSearch looks for it. Keeps its
/// buffers.
class HomographyProblem {
 public:
  using Model = Eigen::Matrix3d;
  static constexpr std::size_t kSample = std::tuple_size<FourPoints>::value;

  /// Stored by reference; best quality first.
  void setPairs(const NormalisedPairs& pairs) { pairs_ = &pairs; }
  std::size_t size() const { return pairs_->size(); }

  template <typename Visit>
  void solve(const prosac::ProsacSample& sample, Visit visit) const {
    Eigen::Matrix3d homography;
    if (solve(sample, homography)) visit(homography);
  }
  float cost(const Eigen::Matrix3d& homography, float give_up) const {
    return msacCost(pairs_->scoring, homography, pairs_->limit, give_up);
  }
  /// False where the pairs within reach are not more than a sample, or do not determine H.
  bool refine(double widening, Eigen::Matrix3d& homography);
  std::size_t findInliers(const Eigen::Matrix3d& homography,
                          std::vector<std::uint8_t>& inlier) const {
    return ktgp_orb::homography::findInliers(pairs_->scoring, homography, pairs_->limit, inlier);
  }

 private:
  bool solve(const prosac::ProsacSample& sample, Eigen::Matrix3d& homography) const;

  const NormalisedPairs* pairs_ = nullptr;
  std::vector<std::uint8_t> near_;  // pairs used by refine()
  MEstimator estimator_;
};

}  // namespace ktgp_orb::homography
