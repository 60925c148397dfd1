#pragma once

#include <cstdint>
#include <vector>

#include "core/growth/local_frame.h"
#include "core/targets/frame_tables.h"
#include "core/targets/picture_search.h"
#include "core/targets/seeds.h"
#include "core/targets/target_store.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb::targets {

/// A target that some pairs of keypoints speak for.
struct Candidate {
  StoredTarget* target;
  std::int32_t votes;  ///< of its best seed
};

/// A target in the frame.
struct FoundTarget {
  StoredTarget* target = nullptr;
  std::uint32_t picture = 0;
  bool predicted = false;
  FoundPicture found;
};

/// Searches targets in one frame. What is found for a target depends on it and the frame alone.
/// Keeps its buffers.
class FrameSearch {
 public:
  FrameSearch(const TargetFinderOptions& options, TargetStore& store)
      : options_(options),
        store_(store),
        whole_(options.orb.scale_factor),
        rest_(options.orb.scale_factor) {}

  /// `number`: of the frame. `features` must live until the last search in this frame.
  void setFrame(const Features& features, std::uint64_t number);

  /// Looks keypoints up in the index of all targets: those from `turn` on of an order in which
  /// neighbours are far apart, at most `count`.
  void lookUp(std::size_t turn, std::size_t count);
  /// The targets that the keypoints looked up speak for, in the order of the targets.
  const std::vector<Candidate>& candidates();

  /// Appends all instances of the target.
  void search(StoredTarget& target, std::vector<FoundTarget>& found);
  /// Looks for one more instance near a prediction (picture's `image` -> frame, px), apart from
  /// those of this target in `found`; appends it.
  void searchNear(StoredTarget& target, std::uint32_t picture, const Eigen::Matrix3d& prediction,
                  std::vector<FoundTarget>& found);

 private:
  bool searchOnce(StoredTarget& target, FoundTarget& result);
  void take(const FoundTarget& found);
  void setRest();

  const TargetFinderOptions& options_;
  TargetStore& store_;
  const Features* features_ = nullptr;
  std::uint64_t number_ = 0;
  std::vector<growth::LocalFrame> frames_;  // of the features
  std::vector<growth::Bits> bits_;          // the same
  FrameTables tables_;
  std::size_t step_ = 1;  // from one keypoint to the next one that is looked up
  std::vector<std::uint32_t> queries_;
  std::vector<IndexHit> hits_;                // of the index, for all targets
  std::vector<std::vector<IndexHit>> pairs_;  // of the pictures of one target
  std::vector<Candidate> candidates_;
  Seeds seeds_;
  PictureSearch whole_;  // all features
  PictureSearch rest_;   // without those that are taken
  std::vector<std::uint8_t> taken_;
  Features rest_features_;
  std::vector<std::int32_t> rest_numbers_;
};

}  // namespace ktgp_orb::targets
