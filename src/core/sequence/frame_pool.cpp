#include "core/sequence/frame_pool.h"

#include "core/util/shared_matrix.h"

namespace ktgp_orb::sequence {
namespace {

// A sequence needs five: new, previous, keyframe, fixed, and that of the last result. The pool
// forgets frames that a caller keeps longer.
constexpr std::size_t kFrames = 6;

void releaseImage(Frame& frame) {
  frame.image.release();
  if (!frame.features.images.empty())
    frame.features.images.front().release();  // shared with the frame
  frame.source.reset();
}

/// A caller may hold a matrix without the frame.
void releaseIfShared(cv::Mat& matrix) {
  if (util::isShared(matrix)) matrix.release();
}

void empty(Frame& frame) {
  releaseImage(frame);
  frame.stamp = 0;
  frame.encoding.clear();
  frame.mask.release();
  frame.lens.reset();
  frame.features.keypoints.clear();
  releaseIfShared(frame.features.descriptors);
  if (!frame.features.descriptors.empty()) frame.features.descriptors.resize(0);
  frame.features.image_size = {};
  frame.orb.reset();
  frame.extraction_milliseconds = 0.0;
}

}  // namespace

// The copy orders memory accesses: all reads of the last holder, maybe in another thread, come
// before the writes here. Reading the count alone would not.
std::shared_ptr<FramePool::PooledFrame> FramePool::freeFrame(std::size_t i) const {
  return frames_[i].use_count() == 1 ? frames_[i] : nullptr;
}

std::shared_ptr<FramePool::PooledFrame> FramePool::takePooled() {
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    std::shared_ptr<PooledFrame> frame = freeFrame(i);
    if (!frame) continue;
    empty(*frame);
    return frame;
  }
  auto frame = std::make_shared<PooledFrame>();
  if (frames_.size() < kFrames) frames_.push_back(frame);
  return frame;
}

FramePtr FramePool::take() {
  return takePooled();
}

FramePtr FramePool::takeCopy(const cv::Mat& image) {
  const std::shared_ptr<PooledFrame> frame = takePooled();
  releaseIfShared(frame->pixels);
  image.copyTo(frame->pixels);
  frame->image = frame->pixels;
  return frame;
}

void FramePool::releaseImages() {
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    if (const auto frame = freeFrame(i)) releaseImage(*frame);
  }
}

}  // namespace ktgp_orb::sequence
