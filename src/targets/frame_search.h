#pragma once

#include <cstdint>
#include <vector>

#include "growth/local_frame.h"
#include "ktgp_orb/features.h"
#include "targets/picture_search.h"
#include "targets/seeds.h"
#include "targets/target_index.h"
#include "targets/target_store.h"

namespace ktgp_orb::targets {

/// A target that may be in the frame: some pairs of its keypoints and keypoints of the frame agree
/// with each other.
struct Candidate {
  StoredTarget* target;
  std::int32_t votes;  ///< votes of the target's best seed (see Seeds)
};

/// Searches for targets in one frame. The result for a target depends only on this target and the
/// frame. Reuses its buffers.
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): in the order of use
class FrameSearch {
 public:
  FrameSearch(const TargetFinderOptions& options, TargetStore& store)
      : options_(options), store_(store), tables_(kKeyBits), thorough_tables_(kThoroughKeyBits) {}

  /// `features`: features of the frame; must live until the last search in this frame. `scale`:
  /// size of the searched image divided by the size of the camera image.
  void setFrame(const Features& features, double scale);

  /// Looks up at most `count` keypoints of the frame in the index of all targets. The keypoints are
  /// looked up in a fixed order, beginning with number `turn` of this order. Keypoints that follow
  /// each other in this order lie in different parts of the frame.
  void lookUp(std::size_t turn, std::size_t count);
  /// The targets that may be in the frame, according to the keypoints looked up so far, sorted by
  /// the numbers of their pictures.
  const std::vector<Candidate>& candidates();

  /// Finds at most options.max_instances instances of the target, appends them to `found`, and
  /// returns their number.
  int search(StoredTarget& target, std::vector<FoundTarget>& found);
  /// Searches for one more instance within `radius` px of a predicted place. Finds it by comparing
  /// the images, not by keypoints. Appends the instance unless `found` has an instance of this
  /// target there. `picture`: number of the picture in the store. `prediction`: predicted
  /// homography from the picture's `image` to the frame, px.
  void searchNear(StoredTarget& target, std::uint32_t picture, const Eigen::Matrix3d& prediction,
                  double radius, std::vector<FoundTarget>& found);

  /// Instances found since setFrame() that PictureSearch::isDetermined() rejects.
  std::vector<FoundTarget>& undetermined() { return undetermined_; }

 private:
  static constexpr int kKeyBits = 13;
  static constexpr int kThoroughKeyBits = 11;  // needs four times as many comparisons as kKeyBits

  int searchWith(FrameTables& tables, StoredTarget& target, std::vector<FoundTarget>& found);
  bool searchOnce(StoredTarget& target, FoundTarget& result);
  void take(const FoundTarget& found);
  void setRest();

  const TargetFinderOptions& options_;
  TargetStore& store_;
  const Features* features_ = nullptr;
  FramePyramid pyramid_;
  std::vector<growth::LocalFrame> frames_;  // local frames of the features
  std::vector<growth::Bits> bits_;          // descriptors of the features
  FrameTables tables_;
  FrameTables thorough_tables_;  // built for the frame only if needed
  bool is_thorough_set_ = false;
  std::size_t step_ = 1;  // from one look-up to the next, the keypoint's index grows by this
  std::vector<std::uint32_t> queries_;
  std::vector<IndexHit> hits_;                // hits that lookUp() has found in the index
  std::vector<std::vector<IndexHit>> pairs_;  // for each picture of a target: its pairs
  std::vector<Candidate> candidates_;
  std::vector<FoundTarget> undetermined_;
  Seeds seeds_;
  std::int32_t most_votes_ = 0;      // most votes of a seed in the last searchWith()
  PictureSearch whole_;              // searches all features
  PictureSearch rest_;               // searches only the features that belong to no found instance
  std::vector<std::uint8_t> taken_;  // non-zero: the feature belongs to an instance that was found
  Features rest_features_;
  std::vector<std::int32_t> rest_numbers_;  // for each of rest_features_, its number in features_
};

}  // namespace ktgp_orb::targets
