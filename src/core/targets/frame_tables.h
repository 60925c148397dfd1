#pragma once

#include <cstdint>
#include <vector>

#include "core/growth/local_frame.h"
#include "core/growth/reference_frames.h"
#include "core/targets/target_index.h"

namespace ktgp_orb::targets {

/// The descriptors of a frame, sorted by parts of them, so that those near a given one are found
/// without comparing all (multi-index hashing: Norouzi, Punjani & Fleet, CVPR 2012). Keeps its
/// buffers.
class FrameTables {
 public:
  void setFrame(const std::vector<growth::Bits>& bits);

  /// For each keypoint of the frame the most similar one of the picture, if there is one: most of
  /// them. Those that no keypoint elsewhere in the picture rivals come first. What is found depends
  /// on this picture and the frame alone.
  void match(std::uint32_t number, const growth::ReferenceFrames& picture,
             std::vector<IndexHit>& pairs);

  static constexpr int kMaxDistance = 64;

 private:
  static constexpr std::size_t kTables = 8;  // one for each 32 bits
  static constexpr int kKeyBits = 13;

  struct Item {
    std::uint32_t keypoint;
    std::uint32_t some_bits;  // others than those of the key, to leave out most at once
  };
  struct Table {
    std::vector<std::uint32_t> start;  // of each key in the items, and the end
    std::vector<Item> items;
  };
  /// Of the picture, for a keypoint of the frame.
  struct Nearest {
    std::uint32_t keypoint = 0;
    int distance = kMaxDistance + 1;
    int elsewhere = kMaxDistance + 1;  // distance of the nearest keypoint at another place
  };

  void compare(std::uint32_t keypoint, const growth::ReferenceFrames& picture);
  void keep(std::uint32_t keypoint, int distance, const growth::ReferenceFrames& picture,
            Nearest& nearest) const;

  std::vector<growth::Bits> bits_;
  Table tables_[kTables];
  std::vector<std::uint32_t> key_of_;
  std::vector<std::uint32_t> compared_;  // for each keypoint, the last one it was compared with
  std::vector<Nearest> nearest_;         // for each keypoint
};

}  // namespace ktgp_orb::targets
