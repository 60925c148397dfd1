#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "util/pool.h"

namespace ktgp_orb::sequence {

/// Hands out frames. When no caller holds a frame any more, its images are released at once, and
/// the frame is reused with its other buffers.
class FramePool {
 public:
  FramePtr take();
  /// A frame with a copy of `image` in a reused buffer.
  FramePtr takeCopy(const cv::Mat& image);

 private:
  struct PooledFrame : Frame {
    cv::Mat pixels;  ///< the frame's own copy of its image
  };

  static void release(PooledFrame& frame);
  std::shared_ptr<PooledFrame> takeEmpty();

  // A sequence holds up to five frames: the new frame, the previous frame, the fixed reference, the
  // keyframe and the frame of the last result.
  util::Pool<PooledFrame> frames_{6, release};
};

/// Numbers the keypoints of a sequence (Frame::tracks). A final match, of Level::ktgp or guided,
/// gives its target keypoint the track number of its reference keypoint. If a reference keypoint
/// has several matches, only the match with the smallest Hamming distance counts. All other
/// keypoints get new numbers.
class TrackNumbers {
 public:
  /// Gives all keypoints new numbers.
  void begin(Frame& frame);
  /// Continues the tracks of `reference`, whose keypoints have numbers. `result`: match of `target`
  /// to `reference`.
  void continueTracks(const Frame& reference, const MatchResult& result, Frame& target);

 private:
  void choose(const std::vector<Correspondence>& matches);

  std::uint64_t next_ = 1;
  // For each keypoint of the reference, the match that continues its track; null if there is none.
  std::vector<const Correspondence*> best_;
};

}  // namespace ktgp_orb::sequence
