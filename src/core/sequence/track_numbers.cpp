#include "core/sequence/track_numbers.h"

#include <numeric>

namespace ktgp_orb::sequence {

void TrackNumbers::begin(Frame& frame) {
  // Room as for the keypoints, so that the numbers allocate no more often than these.
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
