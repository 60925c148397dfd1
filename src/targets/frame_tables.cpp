#include "targets/frame_tables.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace ktgp_orb::targets {
namespace {

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
  nearest_.assign(bits_.size(), {});
  // One table after the other: one fits into the processor's first cache.
  for (std::size_t table = 0; table < kTables; ++table) compare(table, picture);
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

/// Compares the keypoints of the picture with those of the frame that have the same key in one
/// table.
void FrameTables::compare(std::size_t table, const growth::ReferenceFrames& picture) {
  findRuns(table, picture.bits());
  findSimilar(table, picture.bits());
  for (std::size_t i = 0; i < similar_count_; ++i) {
    const Pair& pair = similar_[i];
    const int distance = growth::distance(bits_[pair.of_frame], picture.bits()[pair.of_picture]);
    keep(pair.of_picture, distance, picture, nearest_[pair.of_frame]);
  }
}

/// Most cells are empty, but which ones is random. So all are written, without a branch, and those
/// that do not count are overwritten.
void FrameTables::findRuns(std::size_t number, const std::vector<growth::Bits>& bits) {
  const Table& table = tables_[number];
  runs_.resize(bits.size() + 1);
  run_count_ = 0;
  item_count_ = 0;
  for (std::uint32_t keypoint = 0; keypoint < bits.size(); ++keypoint) {
    const std::uint32_t key = keyOf(bits[keypoint], number, key_bits_);
    const Run run{keypoint, table.start[key], table.start[key + 1]};
    const std::uint32_t length = run.end - run.begin;
    const bool is_used = length <= kFullestCell;
    runs_[run_count_] = run;
    run_count_ += static_cast<std::size_t>(is_used && length > 0);
    item_count_ += is_used ? length : 0;
  }
}

/// Most items differ in the bits that the table keeps; again without a branch.
void FrameTables::findSimilar(std::size_t number, const std::vector<growth::Bits>& bits) {
  const Table& table = tables_[number];
  similar_.resize(item_count_ + 1);
  similar_count_ = 0;
  for (std::size_t r = 0; r < run_count_; ++r) {
    const Run& run = runs_[r];
    const std::uint32_t others = otherBits(bits[run.keypoint], number);
    for (std::uint32_t i = run.begin; i < run.end; ++i) {
      const Item& item = table.items[i];
      similar_[similar_count_] = {run.keypoint, item.keypoint};
      similar_count_ += static_cast<std::size_t>(growth::countBits(item.some_bits ^ others) <=
                                                 kMostDifferentBits);
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
