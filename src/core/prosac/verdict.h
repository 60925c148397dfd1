#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// Says whether the inliers of a homography are more than chance would give.
///
/// The rule is a-contrario (Moisan & Stival, IJCV 2004). Were every target point thrown at random
/// into the area A that the target points cover, a homography through four of the N pairs would
/// bring k - 4 others within e with probability p^(k-4), p = pi e² / A. The number of sets of k
/// pairs and of samples of four in each makes the expected number of homographies with such support
///
///   NFA(k) = (N - 4) C(N, k) C(k, 4) p^(k-4),   e the k-th smallest error, at least 1/sqrt(pi) px,
///
/// and a homography counts as found when NFA(k) < 1e-4 for some k. Inliers are taken with growing
/// error, and only those farther than the threshold, in both images, from every one taken before:
/// repeated keypoints, many-to-one matches and the same corner found in several octaves support a
/// homography once. So four pairs never suffice; five do when exact, of eight six at 3 px.
class ProsacVerdict {
 public:
  /// `squared_error`: reprojection errors in px², one a pair.
  bool explainableByChance(const PointPairs& pairs, const std::vector<std::uint8_t>& mask,
                           const std::vector<double>& squared_error, double threshold);

  /// Inliers counted once per reference and target position: the smaller number of the two.
  std::size_t distinctInliers(const PointPairs& pairs, const std::vector<std::uint8_t>& mask);

 private:
  bool explainable(const PointPairs& pairs, const std::vector<double>& squared_error,
                   double threshold);
  std::size_t distinct(const std::vector<Eigen::Vector2d>& points,
                       const std::vector<std::uint8_t>& mask);
  bool isApart(const PointPairs& pairs, std::size_t candidate, double distance) const;

  std::vector<std::size_t> inliers_;
  std::vector<std::size_t> taken_;    // inliers that count
  std::vector<std::uint32_t> table_;  // hash table of positions
};

}  // namespace ktgp_orb
