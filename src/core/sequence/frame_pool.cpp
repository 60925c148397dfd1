#include "core/sequence/frame_pool.h"

#include "core/util/shared_matrix.h"

namespace ktgp_orb::sequence {
namespace {

/// A caller may hold a matrix without the frame.
void releaseIfShared(cv::Mat& matrix) {
  if (util::isShared(matrix)) matrix.release();
}

void empty(Frame& frame) {
  frame.stamp = 0;
  frame.encoding.clear();
  frame.mask.release();
  frame.lens.reset();
  frame.camera.reset();
  frame.camera_lens.reset();
  frame.features.keypoints.clear();
  releaseIfShared(frame.features.descriptors);
  if (!frame.features.descriptors.empty()) frame.features.descriptors.resize(0);
  frame.features.image_size = {};
  frame.tracks.clear();
  frame.orb.reset();
  frame.extraction_milliseconds = 0.0;
}

}  // namespace

void FramePool::release(PooledFrame& frame) {
  frame.image.release();
  if (!frame.features.images.empty())
    frame.features.images.front().release();  // shared with the frame
  frame.source.reset();
}

std::shared_ptr<FramePool::PooledFrame> FramePool::takeEmpty() {
  std::shared_ptr<PooledFrame> frame = frames_.take();
  empty(*frame);
  return frame;
}

FramePtr FramePool::take() {
  return takeEmpty();
}

FramePtr FramePool::takeCopy(const cv::Mat& image) {
  const std::shared_ptr<PooledFrame> frame = takeEmpty();
  releaseIfShared(frame->pixels);
  image.copyTo(frame->pixels);
  frame->image = frame->pixels;
  return frame;
}

}  // namespace ktgp_orb::sequence
