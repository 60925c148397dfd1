#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "util/pool.h"

namespace ktgp_orb::sequence {

/// Hands out frames. When no caller holds a frame any more, the pool releases its images at once
/// and uses the rest of its memory for a later frame.
class FramePool {
 public:
  FramePtr take();
  /// Returns a frame that holds its own copy of `image`.
  FramePtr takeCopy(const cv::Mat& image);

 private:
  struct PooledFrame : Frame {
    cv::Mat pixels;  ///< memory for takeCopy(), used again and again
  };

  static void release(PooledFrame& frame);
  std::shared_ptr<PooledFrame> takeEmpty();

  // Keep up to six unused frames. A sequence holds up to five: the new frame, the previous frame,
  // the fixed reference, the keyframe and the frame of the last result.
  util::Pool<PooledFrame> frames_{6, release};
};

/// Gives the keypoints of a sequence their track numbers (Frame::tracks). If a match is final
/// (Level::ktgp, or a guided match), its target keypoint gets the track number of its reference
/// keypoint. If a reference keypoint has several such matches, only the match with the smallest
/// Hamming distance counts. All other keypoints get new numbers.
class TrackNumbers {
 public:
  /// Gives all keypoints of the frame new numbers.
  void begin(Frame& frame);
  /// Continues the tracks of `reference`, whose keypoints must have numbers already. `result`: the
  /// match of `target` to `reference`.
  void continueTracks(const Frame& reference, const MatchResult& result, Frame& target);

 private:
  void choose(const std::vector<Correspondence>& matches);

  std::uint64_t next_ = 1;
  // For each keypoint of the reference, the match that continues its track; null if it has no
  // match.
  std::vector<const Correspondence*> best_;
};

}  // namespace ktgp_orb::sequence
