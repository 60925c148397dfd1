#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "growth/grower.h"
#include "growth/local_matcher.h"
#include "growth/verdict.h"
#include "homography/fit.h"
#include "homography/verdict.h"
#include "ktgp_orb/features.h"
#include "targets/appearance.h"
#include "targets/picture_aligner.h"
#include "targets/seeds.h"
#include "targets/target_picture.h"

namespace ktgp_orb::targets {

/// A picture of a target that was found in the frame. The caller of PictureSearch sets the first
/// three members.
struct FoundTarget {
  StoredTarget* target = nullptr;
  std::uint32_t picture = 0;     ///< number of the picture in the store
  bool predicted = false;        ///< the picture was found at the place that a track predicts
  UncertainHomography estimate;  ///< homography from the picture's `image` to the frame, px
  bool aligned = false;
  PointPairs pairs;  ///< pairs to which `estimate` was fitted, px of `image` and of the frame
  /// Numbers of the keypoints of the frame that agree with `estimate`.
  std::vector<std::int32_t> keypoints;
  double log_false_alarms = 0.0;  ///< log10 of the expected number of false alarms
  /// Share of the visible part that looks like the picture, 0..1; 0 if the images were not
  /// compared.
  double agreement = 0.0;
};

/// Searches for a picture in a frame, from seeds or a predicted homography. Reuses its buffers.
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): in the order of use
class PictureSearch {
 public:
  /// `features`: the features of the frame to search in. `numbers`: for each of them, its number
  /// among all features of the frame; empty if `features` are all of them. `frame`: may have no
  /// images.
  void setFrame(const Features& features, const std::vector<std::int32_t>& numbers,
                const FramePyramid& frame);

  /// Tries the best seeds, at most kMostSeeds, until a seed grows to a homography that is too good
  /// to be a chance hit. `pictures`: number of known pictures; each picture is one more opportunity
  /// for a chance hit.
  bool fromSeeds(TargetPicture& picture, const std::vector<Seed>& seeds, std::size_t pictures,
                 FoundTarget& found);
  /// Follows a picture that was seen in the last frame. Finds it by comparing the images near the
  /// predicted place, not by keypoints; then aligns the images. `prediction`: picture -> frame,
  /// with an error of at most about `radius` px.
  bool follow(TargetPicture& picture, const Eigen::Matrix3d& prediction, double radius,
              FoundTarget& found);
  /// Refines the homography by aligning patches of the picture with the frame.
  void align(const TargetPicture& picture, FoundTarget& found);
  /// Compares the images again if their agreement before the alignment was small. Returns false if
  /// most of the visible part looks different.
  bool confirm(const TargetPicture& picture, std::size_t pictures, FoundTarget& found);
  /// Returns false if so little of the picture is in view that the positions of its corners are
  /// uncertain.
  static bool isDetermined(const TargetPicture& picture, const FoundTarget& found);

  /// A picture counts as found if log10 of the expected number of false alarms is below this limit.
  /// The first limit is for a search of the whole frame, the second for a followed target.
  static constexpr double kLogMaxFalseAlarms = -8.0;
  static constexpr double kLogMaxOfTrack = -4.0;

  static constexpr int kMostSeeds = 8;
  /// Maximum numbers of attempts for one picture in a frame; each attempt is an opportunity for a
  /// chance hit. Seeds come from two kinds of tables, and each seed can give three homographies.
  static constexpr int kAllSeeds = 2 * kMostSeeds;
  static constexpr int kAllHomographies = 3 * kAllSeeds;

 private:
  bool grow(TargetPicture& picture, const Eigen::Vector2d& centre, std::size_t pictures,
            Eigen::Matrix3d map, FoundTarget& found);
  bool growByImages(TargetPicture& picture, const Eigen::Vector2d& centre, std::size_t pictures,
                    const Eigen::Matrix3d& map, FoundTarget& found);
  bool fitSeeds(const std::vector<Seed>& seeds, Eigen::Matrix3d& map);
  bool accept(TargetPicture& picture, const Eigen::Matrix3d& map, std::size_t pictures,
              FoundTarget& found);
  /// Refines `start` by aligning patches. Returns true and stores the result in `found` if this
  /// succeeds.
  bool alignFrom(const UncertainHomography& start, const TargetPicture& picture,
                 FoundTarget& found);
  Appearance::Similarity similarity(const TargetPicture& picture, std::size_t pictures,
                                    const FoundTarget& found);
  bool isSeen(const TargetPicture& picture, std::size_t pictures, FoundTarget& found);
  void takePairs(FoundTarget& found) const;
  bool fit(const TargetPicture& picture, const Eigen::Matrix3d& map, FoundTarget& found);
  bool isExplained(const Seed& seed) const;
  /// Removes the pairs of `found` that `labelled_` marks as outliers.
  void dropOutliers(FoundTarget& found);

  FramePyramid frame_;
  Appearance appearance_;
  growth::LocalMatcher matcher_;
  growth::Grower grower_{growth::kTargetPlan};
  std::vector<std::int32_t> numbers_;
  growth::Verdict verdict_;
  homography::HomographyRefiner refiner_;
  homography::HomographyVerdict trust_;
  ProsacResult labelled_;
  PictureAligner aligner_;
  UncertainHomography aligned_;
  PointPairs aligned_pairs_;
  std::vector<Eigen::Matrix3d> tried_;
  PointPairs seed_pairs_;
};

}  // namespace ktgp_orb::targets
