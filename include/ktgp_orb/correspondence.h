#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace ktgp_orb {

/// The last stage that a correspondence passed, of the four stages nearest-neighbour search (KNN),
/// ratio filter (TF), GMS and PROSAC. A match of Level::ktg has also passed KNN and TF, so the
/// matches that the paper calls KT are all matches with a level >= Level::kt.
enum class Level : std::uint8_t {
  knn = 0,   ///< nearest neighbour; removed by the ratio filter (TF)
  kt = 1,    ///< passed KNN + TF; removed by GMS, or by the filter that replaces it
  ktg = 2,   ///< passed KNN + TF + GMS; removed by PROSAC
  ktgp = 3,  ///< inlier of the homography or, if the geometry is epipolar, of this geometry
  /// Inlier of the homography, found by guided matching or growth near the position that the
  /// homography predicts. KtgpMatcher puts these matches into a list of their own
  /// (MatchResult::guided); the counts of the four stages do not include them.
  guided = 4,
};

/// A target feature and the reference feature whose descriptor is nearest.
struct Correspondence {
  /// Index of the keypoint in the reference frame. It is -1 (only at Level::knn) if matchNear found
  /// no keypoint near enough.
  std::int32_t reference_index = -1;
  std::int32_t target_index = -1;  ///< index of the keypoint in the target frame
  std::int32_t distance = 0;       ///< d1, Hamming distance to the nearest descriptor, 0..256
  /// Hamming distance d2 to the second nearest descriptor, d1..256; 0 if there is no second one.
  std::int32_t second_distance = 0;
  Level level = Level::knn;
  /// True if the match also holds in the other direction: of all target descriptors, the target
  /// descriptor of this match is the nearest to its reference descriptor. Computed only if
  /// MatcherOptions::mutual is on, or if growth is on and the whole image is searched; otherwise it
  /// is false.
  bool mutual = false;

  /// W = d1/d2 (Eq. 3), which is also PROSAC's quality (Eq. 6, smaller is better). If the two
  /// nearest descriptors are both identical to the target's (d2 = 0), the match is ambiguous, and W
  /// is 1, which no threshold T_w <= 1 accepts.
  double ratio() const;
};

/// Number of correspondences that reached at least `level`.
std::size_t countAtLeast(const std::vector<Correspondence>& correspondences, Level level);

}  // namespace ktgp_orb
