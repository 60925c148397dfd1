#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace ktgp_orb {

/// The last stage of KNN -> TF -> GMS -> PROSAC that a correspondence passed. A level includes all
/// levels above it: the paper's KT matches are those with level >= Level::kt.
enum class Level : std::uint8_t {
  knn = 0,   ///< nearest neighbour, removed by the ratio filter
  kt = 1,    ///< passed KNN + TF, removed by GMS
  ktg = 2,   ///< passed KNN + TF + GMS, removed by PROSAC
  ktgp = 3,  ///< inlier of the homography
  /// Found by guided matching or growth near the position that the homography predicts, and one of
  /// its inliers. These matches are in a separate list and do not count in the four stages.
  guided = 4,
};

/// A target feature and the reference feature nearest to it.
struct Correspondence {
  /// Keypoint in the reference frame. -1 (only at Level::knn): matchNear found none near enough.
  std::int32_t reference_index = -1;
  std::int32_t target_index = -1;    ///< keypoint in the target frame
  std::int32_t distance = 0;         ///< d1, Hamming distance to the nearest, 0..256
  std::int32_t second_distance = 0;  ///< d2, Hamming distance to the second nearest, d1..256
  Level level = Level::knn;
  /// Whether the target feature is also the nearest to the reference feature. Only computed if
  /// MatcherOptions::mutual is on, or if growth is on and the whole image is searched; else false.
  bool mutual = false;

  /// W = d1/d2 (Eq. 3), also PROSAC's quality (Eq. 6, smaller is better). 1 for two identical
  /// candidates (d2 = 0): they are ambiguous, and no threshold T_w <= 1 accepts them.
  double ratio() const;
};

/// Number of correspondences that reached at least `level`.
std::size_t countAtLeast(const std::vector<Correspondence>& correspondences, Level level);

}  // namespace ktgp_orb
