#pragma once

#include <memory>

#include "core/util/pool.h"
#include "ktgp_orb/sequence_matcher.h"

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

}  // namespace ktgp_orb::sequence
