#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/prosac/verdict.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// Area in px² that the points cover: their bounding box without those that lie far out (Tukey,
/// 1977: more than three interquartile ranges beyond the quartiles, in either direction). A single
/// wild point would otherwise make every agreement of the others look like more than chance.
double coveredArea(const std::vector<Eigen::Vector2d>& points);

/// Chance that a pair agrees with a wrong homography: a random target point within `distance` px.
/// Never below 1 %, as keypoints are not spread evenly, and never above one half.
double chanceInlier(double covered_area, double distance);

/// Says whether the inliers of a homography are more than chance would give, by the a-contrario
/// rule of core/prosac/verdict.h. Were every target point thrown at random into the area A that the
/// target points cover, a pair would agree within e with p = pi e² / A; e is never taken below
/// 1/sqrt(pi) px. Only inliers farther than the threshold, in both images, from every one taken
/// before count: repeated keypoints, many-to-one matches and the same corner found in several
/// octaves support a homography once. So four pairs never suffice; five do when exact, of eight six
/// at 3 px.
class HomographyVerdict {
 public:
  /// `squared_error`: reprojection errors in px², one a pair; `covered_area`: of the target points.
  bool explainableByChance(const PointPairs& pairs, const std::vector<std::uint8_t>& mask,
                           const std::vector<double>& squared_error, double threshold,
                           double covered_area);

  /// Inliers counted once per reference and target position: the smaller number of the two.
  std::size_t distinctInliers(const PointPairs& pairs, const std::vector<std::uint8_t>& mask);

 private:
  std::size_t distinct(const std::vector<Eigen::Vector2d>& points,
                       const std::vector<std::uint8_t>& mask);

  ProsacVerdict verdict_;
  std::vector<std::size_t> inliers_;
  std::vector<std::uint32_t> table_;  // hash table of positions
};

}  // namespace ktgp_orb
