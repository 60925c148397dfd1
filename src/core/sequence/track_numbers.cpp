#include "core/sequence/track_numbers.h"

#include <numeric>

namespace ktgp_orb::sequence {

void TrackNumbers::begin(Frame& frame) {
  // As much as the keypoints, which have room for the most that the extractor gives.
  frame.tracks.reserve(frame.features.keypoints.capacity());
  frame.tracks.resize(frame.features.size());
  std::iota(frame.tracks.begin(), frame.tracks.end(), next_);
  next_ += frame.tracks.size();
}

void TrackNumbers::choose(const std::vector<Correspondence>& matches) {
  for (const Correspondence& c : matches) {
    if (c.level < Level::ktgp) continue;
    Heir& heir = heirs_[static_cast<std::size_t>(c.reference_index)];
    if (heir.target < 0 || c.distance < heir.distance) heir = {c.target_index, c.distance};
  }
}

void TrackNumbers::carryOn(const Frame& reference, const MatchResult& result, Frame& target) {
  begin(target);
  heirs_.reserve(reference.features.keypoints.capacity());
  heirs_.assign(reference.features.size(), {});
  choose(result.correspondences);
  choose(result.guided);
  for (std::size_t i = 0; i < heirs_.size(); ++i) {
    if (heirs_[i].target < 0) continue;
    target.tracks[static_cast<std::size_t>(heirs_[i].target)] = reference.tracks[i];
  }
}

}  // namespace ktgp_orb::sequence
