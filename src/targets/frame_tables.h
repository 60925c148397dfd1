#pragma once

#include <cstdint>
#include <vector>

#include "core/growth/local_frame.h"
#include "core/growth/reference_frames.h"
#include "targets/target_index.h"

namespace ktgp_orb::targets {

/// Finds the descriptors of a frame that are similar to a given one without a comparison with all:
/// each of several tables sorts them by another part of their bits (multi-index hashing: Norouzi,
/// Punjani & Fleet, CVPR 2012). Keeps its buffers.
class FrameTables {
 public:
  /// `key_bits`: 8..16, equal bits of descriptors that are compared. Fewer ones find more pairs and
  /// take longer.
  explicit FrameTables(int key_bits) : key_bits_(key_bits) {}

  void setFrame(const std::vector<growth::Bits>& bits);

  /// Pairs each keypoint of the frame with the most similar one of the picture, if one is similar
  /// enough; a few are missed. Clear pairs come first: those where the second most similar keypoint
  /// of the picture, at another place, is much less similar. The pairs depend only on this picture
  /// and the frame.
  void match(std::uint32_t number, const growth::ReferenceFrames& picture,
             std::vector<IndexHit>& pairs);

  static constexpr int kMaxDistance = 64;

 private:
  static constexpr std::size_t kTables = 8;  // one for each 32 bits

  struct Item {
    std::uint32_t keypoint;
    std::uint32_t some_bits;  // not part of the key; enough to see that most items differ
  };
  struct Table {
    std::vector<std::uint32_t> start;  // of each key in the items, and the end
    std::vector<Item> items;
  };
  /// The most similar keypoint of the picture, for one keypoint of the frame.
  struct Nearest {
    std::uint32_t keypoint = 0;
    int distance = kMaxDistance + 1;
    int elsewhere = kMaxDistance + 1;  // distance of the nearest keypoint at another place
  };

  /// A keypoint of the picture and the items of the frame that have the same key.
  struct Run {
    std::uint32_t keypoint, begin, end;
  };

  struct Pair {
    std::uint32_t of_picture, of_frame;  // keypoints
  };

  void compare(std::size_t table, const growth::ReferenceFrames& picture);
  void findRuns(std::size_t table, const std::vector<growth::Bits>& bits);
  void findSimilar(std::size_t table, const std::vector<growth::Bits>& bits);
  void keep(std::uint32_t keypoint, int distance, const growth::ReferenceFrames& picture,
            Nearest& nearest) const;

  int key_bits_;
  std::vector<growth::Bits> bits_;
  Table tables_[kTables];
  std::vector<std::uint32_t> key_of_;
  std::vector<Run> runs_;      // the first run_count_ of them
  std::vector<Pair> similar_;  // the first similar_count_; these are compared in all bits
  std::size_t run_count_ = 0, item_count_ = 0, similar_count_ = 0;
  std::vector<Nearest> nearest_;  // for each keypoint of the frame
};

}  // namespace ktgp_orb::targets
