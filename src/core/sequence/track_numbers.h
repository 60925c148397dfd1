#pragma once

#include <cstdint>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Numbers the keypoints of a sequence (Frame::tracks). A final match, of Level::ktgp or guided,
/// gives its target keypoint the number of its reference keypoint; of several matches of one
/// reference keypoint, that with the smallest distance. All other keypoints get new numbers.
class TrackNumbers {
 public:
  /// New numbers for all keypoints.
  void begin(Frame& frame);
  /// `result`: of the match of `target` to `reference`, which has numbers.
  void carryOn(const Frame& reference, const MatchResult& result, Frame& target);

 private:
  struct Heir {
    std::int32_t target = -1;
    std::int32_t distance = 0;
  };

  void choose(const std::vector<Correspondence>& matches);

  std::uint64_t next_ = 1;
  std::vector<Heir> heirs_;  // of the reference's keypoints
};

}  // namespace ktgp_orb::sequence
