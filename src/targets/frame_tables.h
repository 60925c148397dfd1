#pragma once

#include <cstdint>
#include <vector>

#include "core/growth/local_frame.h"
#include "core/growth/reference_frames.h"
#include "targets/bit_tables.h"
#include "targets/target_index.h"

namespace ktgp_orb::targets {

/// Pairs the keypoints of one picture with those of the frame. Keeps its buffers.
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
  /// The most similar keypoint of the picture, for one keypoint of the frame.
  struct Nearest {
    std::uint32_t keypoint = 0;
    int distance = kMaxDistance + 1;
    int elsewhere = kMaxDistance + 1;  // distance of the nearest keypoint at another place
  };

  void keep(std::uint32_t keypoint, int distance, const growth::ReferenceFrames& picture,
            Nearest& nearest) const;

  int key_bits_;
  std::vector<growth::Bits> bits_;
  BitTables tables_{32, 10};
  BitTables::Found found_;
  std::vector<Nearest> nearest_;  // for each keypoint of the frame
};

}  // namespace ktgp_orb::targets
