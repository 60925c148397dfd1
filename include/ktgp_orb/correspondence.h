#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace ktgp_orb {

/// How far a correspondence came through KNN -> TF -> GMS -> PROSAC. A level includes all below it:
/// the KT matches of the paper are those with level >= Level::kt.
enum class Level : std::uint8_t {
  knn = 0,   ///< nearest neighbour, removed by the ratio filter
  kt = 1,    ///< passed KNN + TF, removed by GMS
  ktg = 2,   ///< passed KNN + TF + GMS, removed by PROSAC
  ktgp = 3,  ///< inlier of the homography
  /// Found by guided matching or growth where the homography says, and inlier of it. These stand in
  /// a list of their own, so that they count in none of the four stages.
  guided = 4,
};

/// A target feature and the reference feature nearest to it.
struct Correspondence {
  /// Keypoint in the reference frame; -1, at Level::knn alone: none was near enough (matchNear).
  std::int32_t reference_index = -1;
  std::int32_t target_index = -1;    ///< keypoint in the target frame
  std::int32_t distance = 0;         ///< d1, Hamming distance to the nearest, 0..256
  std::int32_t second_distance = 0;  ///< d2, Hamming distance to the second nearest, d1..256
  Level level = Level::knn;
  /// Whether the target feature is also the nearest to the reference feature; false where nobody
  /// asked (MatcherOptions::mutual).
  bool mutual = false;

  /// W = d1/d2 (Eq. 3), also PROSAC's quality (Eq. 6, smaller is better). Two identical candidates
  /// (d2 = 0) are ambiguous: 1, which no threshold T_w <= 1 lets pass.
  double ratio() const;
};

/// Number of correspondences that reached at least `level`.
std::size_t countAtLeast(const std::vector<Correspondence>& correspondences, Level level);

}  // namespace ktgp_orb
