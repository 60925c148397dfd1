#include "targets/frame_tables.h"

#include <algorithm>
#include <cmath>

namespace ktgp_orb::targets {

void FrameTables::setFrame(const std::vector<growth::Bits>& bits) {
  bits_ = bits;
  tables_.build(bits.size(), key_bits_,
                [&](std::size_t i) -> const growth::Bits& { return bits[i]; });
}

void FrameTables::match(std::uint32_t number, const growth::ReferenceFrames& picture,
                        std::vector<IndexHit>& pairs) {
  const std::vector<growth::Bits>& wanted = picture.bits();
  nearest_.assign(bits_.size(), {});
  // One table after the other: one fits into the processor's first cache.
  for (std::size_t table = 0; table < BitTables::kTables; ++table) {
    tables_.find(
        table, table + 1, wanted.size(),
        [&](std::uint32_t q) -> const growth::Bits& { return wanted[q]; }, found_);
    for (std::size_t i = 0; i < found_.count; ++i) {
      const auto [keypoint, of_frame] = found_.pairs[i];
      keep(keypoint, growth::distance(bits_[of_frame], wanted[keypoint]), picture,
           nearest_[of_frame]);
    }
  }
  pairs.clear();
  for (std::uint32_t query = 0; query < nearest_.size(); ++query) {
    const Nearest& nearest = nearest_[query];
    if (nearest.distance <= kMaxDistance) {
      pairs.push_back({number, nearest.keypoint, query, nearest.distance});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(), [&](const IndexHit& a, const IndexHit& b) {
    return a.distance * nearest_[b.query].elsewhere < b.distance * nearest_[a.query].elsewhere;
  });
}

/// Remembers the keypoint of the picture if it is the most similar one so far, or the most similar
/// one at another place.
void FrameTables::keep(std::uint32_t keypoint, int distance, const growth::ReferenceFrames& picture,
                       Nearest& nearest) const {
  constexpr float kApart = 8.F;  // px of the picture
  if (distance >= nearest.elsewhere) return;
  const growth::LocalFrame& a = picture.frames()[keypoint];
  const growth::LocalFrame& b = picture.frames()[nearest.keypoint];
  const bool is_apart = std::abs(a.x - b.x) > kApart || std::abs(a.y - b.y) > kApart;
  if (distance < nearest.distance) {
    if (is_apart) nearest.elsewhere = nearest.distance;
    nearest.keypoint = keypoint;
    nearest.distance = distance;
  } else if (is_apart) {
    nearest.elsewhere = distance;
  }
}

}  // namespace ktgp_orb::targets
