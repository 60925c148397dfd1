#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "util/pool.h"

namespace ktgp_orb::sequence {

/// Hands out frames, and reuses them with their buffers when no caller holds them any more. Their
/// images are released at once.
class FramePool {
 public:
  /// An empty frame.
  FramePtr take();
  /// A frame with a copy of `image` in a reused buffer.
  FramePtr takeCopy(const cv::Mat& image);

 private:
  struct PooledFrame : Frame {
    cv::Mat pixels;  ///< the frame's own copy of its image
  };

  static void release(PooledFrame& frame);
  std::shared_ptr<PooledFrame> takeEmpty();

  // A sequence holds up to five: new, previous and fixed frame, keyframe, frame of the last result.
  util::Pool<PooledFrame> frames_{6, release};
};

/// Numbers the keypoints of a sequence (Frame::tracks). A final match, of Level::ktgp or guided,
/// gives its target keypoint the number of its reference keypoint. Of several matches of a
/// reference keypoint, the nearest in Hamming distance counts. All other keypoints get new numbers.
class TrackNumbers {
 public:
  /// Gives all keypoints new numbers.
  void begin(Frame& frame);
  /// Continues the tracks of `reference`, which has numbers. `result`: match of `target` to it.
  void continueTracks(const Frame& reference, const MatchResult& result, Frame& target);

 private:
  void choose(const std::vector<Correspondence>& matches);

  std::uint64_t next_ = 1;
  // The match that continues the track of each keypoint of the reference; null: none.
  std::vector<const Correspondence*> best_;
};

}  // namespace ktgp_orb::sequence
