#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "util/pool.h"

namespace ktgp_orb::sequence {

/// Hands out frames and reuses them, with their buffers, when no caller holds them any more; their
/// images are released at once.
class FramePool {
 public:
  /// An empty frame.
  FramePtr take();
  /// A frame with a copy of `image` in a reused buffer.
  FramePtr takeCopy(const cv::Mat& image);

 private:
  struct PooledFrame : Frame {
    cv::Mat pixels;  ///< the frame's own
  };

  static void release(PooledFrame& frame);
  std::shared_ptr<PooledFrame> takeEmpty();

  // A sequence needs five: new, previous, keyframe, fixed, and that of the last result.
  util::Pool<PooledFrame> frames_{6, release};
};

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
