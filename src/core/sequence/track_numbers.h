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
  void continueTracks(const Frame& reference, const MatchResult& result, Frame& target);

 private:
  void choose(const std::vector<Correspondence>& matches);

  std::uint64_t next_ = 1;
  // The match that continues the track of each keypoint of the reference; null: none.
  std::vector<const Correspondence*> best_;
};

}  // namespace ktgp_orb::sequence
