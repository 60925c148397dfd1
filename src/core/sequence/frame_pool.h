#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Hands out frames and reuses them, with their buffers, when no caller holds them any more.
class FramePool {
 public:
  /// An empty frame.
  FramePtr take();
  /// A frame with a copy of `image` in a reused buffer.
  FramePtr takeCopy(const cv::Mat& image);
  /// Releases the images of frames that are no longer in use.
  void releaseImages();

 private:
  struct PooledFrame : Frame {
    cv::Mat pixels;  ///< the frame's own
  };

  /// Frame `i` if it is not in use; else null.
  std::shared_ptr<PooledFrame> freeFrame(std::size_t i) const;
  std::shared_ptr<PooledFrame> takePooled();

  std::vector<std::shared_ptr<PooledFrame>> frames_;
};

}  // namespace ktgp_orb::sequence
