#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Hands out frames and takes them back once nobody holds them, so that their buffers live on.
class FramePool {
 public:
  /// An empty frame.
  FramePtr take();
  /// A frame with a copy of `image` in a buffer that lives on.
  FramePtr takeCopy(const cv::Mat& image);
  /// Lets go of the images of frames that nobody holds any more.
  void releaseImages();

 private:
  struct PooledFrame : Frame {
    cv::Mat pixels;  ///< the frame's own
  };

  /// Frame `i`, where nobody else holds it; else null.
  std::shared_ptr<PooledFrame> freeFrame(std::size_t i) const;
  std::shared_ptr<PooledFrame> takePooled();

  std::vector<std::shared_ptr<PooledFrame>> frames_;
};

}  // namespace ktgp_orb::sequence
