#include "core/targets/frame_tables.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace ktgp_orb::targets {
namespace {

constexpr std::uint32_t kNeverCompared = std::numeric_limits<std::uint32_t>::max();
// Cells with more items are skipped: many keypoints have these bits, so they say little.
constexpr std::uint32_t kFullestCell = 32;
constexpr int kMostDifferentBits = 10;  // of the 32 bits that are not part of the key

std::uint32_t keyOf(const growth::Bits& bits, std::size_t table, int width) {
  return static_cast<std::uint32_t>(bits[table / 2] >> (32 * (table % 2))) & ((1U << width) - 1U);
}

/// 32 bits of the next word of the descriptor, which are not part of the table's key.
std::uint32_t otherBits(const growth::Bits& bits, std::size_t table) {
  return static_cast<std::uint32_t>(bits[(table / 2 + 1) % 4] >> 16);
}

}  // namespace

void FrameTables::setFrame(const std::vector<growth::Bits>& bits) {
  bits_ = bits;
  key_of_.resize(bits.size());
  for (std::size_t t = 0; t < kTables; ++t) {
    Table& table = tables_[t];
    table.start.assign((std::size_t{1} << key_bits_) + 1, 0);
    for (std::size_t i = 0; i < bits.size(); ++i) {
      key_of_[i] = keyOf(bits[i], t, key_bits_);
      ++table.start[key_of_[i]];
    }
    std::partial_sum(table.start.begin(), table.start.end(), table.start.begin());
    table.items.resize(bits.size());
    // `start` has the ends of the cells here. Each item moves one of them down, so it has their
    // beginnings afterwards. Backwards, so that the items of a cell keep their order.
    for (std::size_t i = bits.size(); i-- > 0;) {
      table.items[--table.start[key_of_[i]]] = {static_cast<std::uint32_t>(i),
                                                otherBits(bits[i], t)};
    }
  }
}

void FrameTables::match(std::uint32_t number, const growth::ReferenceFrames& picture,
                        std::vector<IndexHit>& pairs) {
  compared_.assign(bits_.size(), kNeverCompared);
  nearest_.assign(bits_.size(), {});
  for (std::uint32_t keypoint = 0; keypoint < picture.bits().size(); ++keypoint) {
    compare(keypoint, picture);
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

/// Compares a keypoint of the picture with those of the frame that have a part in common with it.
void FrameTables::compare(std::uint32_t keypoint, const growth::ReferenceFrames& picture) {
  const growth::Bits& bits = picture.bits()[keypoint];
  for (std::size_t t = 0; t < kTables; ++t) {
    const Table& table = tables_[t];
    const std::uint32_t key = keyOf(bits, t, key_bits_);
    const std::uint32_t begin = table.start[key];
    const std::uint32_t end = table.start[key + 1];
    if (end - begin > kFullestCell) continue;
    const std::uint32_t others = otherBits(bits, t);
    for (std::uint32_t i = begin; i < end; ++i) {
      const Item& item = table.items[i];
      if (growth::countBits(item.some_bits ^ others) > kMostDifferentBits) continue;
      if (compared_[item.keypoint] == keypoint) continue;
      compared_[item.keypoint] = keypoint;
      const int distance = growth::distance(bits_[item.keypoint], bits);
      keep(keypoint, distance, picture, nearest_[item.keypoint]);
    }
  }
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
