#include "sequence/frames.h"

#include <numeric>

#include "util/shared_matrix.h"

namespace ktgp_orb::sequence {
namespace {

/// Releases the matrix if a caller still uses its memory, so that the next frame does not overwrite
/// this memory. A caller may keep the matrix even after it has released the frame.
void releaseIfShared(cv::Mat& matrix) {
  if (util::isShared(matrix)) matrix.release();
}

}  // namespace

void FramePool::release(PooledFrame& frame) {
  frame.image.release();
  if (!frame.features.images.empty())
    frame.features.images.front().release();  // it shares its pixels with frame.image
  frame.source.reset();
}

std::shared_ptr<FramePool::PooledFrame> FramePool::takeEmpty() {
  std::shared_ptr<PooledFrame> frame = frames_.take();
  const FrameInput nothing;
  static_cast<FrameInput&>(*frame) = nothing;  // a copy, which keeps the memory of the string
  frame->features.keypoints.clear();
  releaseIfShared(frame->features.descriptors);
  if (!frame->features.descriptors.empty()) frame->features.descriptors.resize(0);
  frame->features.image_size = {};
  frame->tracks.clear();
  frame->orb.reset();
  frame->extraction_milliseconds = 0.0;
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

void TrackNumbers::begin(Frame& frame) {
  // Reserve as much room for track numbers as for keypoints. Then a frame allocates new memory for
  // its track numbers only when it does so for its keypoints.
  frame.tracks.reserve(frame.features.keypoints.capacity());
  frame.tracks.resize(frame.features.size());
  std::iota(frame.tracks.begin(), frame.tracks.end(), next_);
  next_ += frame.tracks.size();
}

void TrackNumbers::choose(const std::vector<Correspondence>& matches) {
  for (const Correspondence& c : matches) {
    if (c.level < Level::ktgp) continue;
    const Correspondence*& best = best_[static_cast<std::size_t>(c.reference_index)];
    if (best == nullptr || c.distance < best->distance) best = &c;
  }
}

void TrackNumbers::continueTracks(const Frame& reference, const MatchResult& result,
                                  Frame& target) {
  begin(target);
  best_.reserve(reference.features.keypoints.capacity());
  best_.assign(reference.features.size(), nullptr);
  choose(result.correspondences);
  choose(result.guided);
  for (std::size_t i = 0; i < best_.size(); ++i) {
    if (best_[i] == nullptr) continue;
    target.tracks[static_cast<std::size_t>(best_[i]->target_index)] = reference.tracks[i];
  }
}

}  // namespace ktgp_orb::sequence
