#include "targets/target_index.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace ktgp_orb::targets {

void TargetIndex::add(std::uint32_t picture, const std::vector<growth::Bits>& bits) {
  if (pictures_.size() <= picture) {
    pictures_.resize(picture + 1, nullptr);
    is_used_.resize(picture + 1, 0);
  }
  pictures_[picture] = &bits;
  is_used_[picture] = 1;
  is_changing_ = true;
  Segment fresh;
  for (std::uint32_t i = 0; i < bits.size(); ++i) fresh.entries.push_back({picture, i});
  // Merge the new segment with the segments at the end of the list, one after the other, until the
  // next one is larger than the merged segment, like the carries of a binary counter. So each
  // descriptor is sorted only a few times.
  std::size_t first = segments_.size();
  std::size_t size = fresh.entries.size();
  while (first > 0 && segments_[first - 1].entries.size() <= size) {
    size += segments_[--first].entries.size();
  }
  segments_.push_back(std::move(fresh));
  mergeFrom(first);
}

void TargetIndex::remove(std::uint32_t picture) {
  removed_ += pictures_[picture]->size();
  pictures_[picture] = nullptr;
  is_changing_ = true;
}

void TargetIndex::optimise() {
  constexpr std::size_t kOneIn = 8;
  const bool was_changing = std::exchange(is_changing_, false);
  if (segments_.empty()) return;
  const std::size_t largest = segments_[0].entries.size();
  std::size_t others = removed_;
  for (std::size_t i = 1; i < segments_.size(); ++i) others += segments_[i].entries.size();
  // Merging drops the removed entries. If they outnumber the entries of the largest segment, merge
  // even while targets keep changing, so that the index does not grow without limit.
  if (removed_ > largest || (kOneIn * others > largest && !was_changing)) mergeFrom(0);
}

/// Merges segment `first` and all later segments into one segment, without the entries of removed
/// pictures.
void TargetIndex::mergeFrom(std::size_t first) {
  Segment merged;
  for (std::size_t i = first; i < segments_.size(); ++i) {
    for (const Entry& entry : segments_[i].entries) {
      if (pictures_[entry.picture] != nullptr) merged.entries.push_back(entry);
    }
  }
  segments_.resize(first);
  if (first == 0) {
    removed_ = 0;
    for (std::size_t i = 0; i < pictures_.size(); ++i)
      is_used_[i] = pictures_[i] != nullptr ? 1 : 0;
  }
  const std::vector<Entry>& entries = merged.entries;
  int key_bits = 8;  // chosen so that there is about one cell per descriptor
  while (key_bits < BitTables::kMaxKeyBits && std::size_t{1} << key_bits < entries.size()) {
    ++key_bits;
  }
  merged.tables.build(entries.size(), key_bits,
                      [&](std::size_t e) -> const growth::Bits& { return bitsOf(entries[e]); });
  segments_.push_back(std::move(merged));
}

void TargetIndex::search(const std::vector<growth::Bits>& wanted,
                         const std::vector<std::uint32_t>& queries, std::vector<IndexHit>& hits) {
  for (std::size_t first = 0; first < queries.size(); first += kBlock) {
    const std::size_t count = std::min(kBlock, queries.size() - first);
    for (std::size_t i = 0; i < count; ++i) nearest_[i].clear();
    for (const Segment& segment : segments_) {
      searchSegment(segment, wanted, &queries[first], count);
    }
    for (std::size_t i = 0; i < count; ++i) {
      hits.insert(hits.end(), nearest_[i].begin(), nearest_[i].end());
    }
  }
}

/// Works in steps. Each step prefetches the memory that the next step reads.
void TargetIndex::searchSegment(const Segment& segment, const std::vector<growth::Bits>& wanted,
                                const std::uint32_t* queries, std::size_t count) {
  segment.tables.find(
      0, BitTables::kTables, count,
      [&](std::uint32_t q) -> const growth::Bits& { return wanted[queries[q]]; }, similar_);
  const auto pairs = similar_.pairs.begin();
  auto end = pairs + static_cast<std::ptrdiff_t>(similar_.count);
  std::for_each(pairs, end, [&](const BitTables::Similar& pair) {
    __builtin_prefetch(&segment.entries[pair.item]);
  });
  end = std::remove_if(pairs, end, [&](const BitTables::Similar& pair) {
    const Entry& entry = segment.entries[pair.item];
    const bool is_removed = pictures_[entry.picture] == nullptr;
    if (!is_removed) __builtin_prefetch(&bitsOf(entry));
    return is_removed;
  });
  std::for_each(pairs, end, [&](const BitTables::Similar& pair) {
    const Entry& entry = segment.entries[pair.item];
    const std::uint32_t query = queries[pair.query];
    const int distance = growth::distance(bitsOf(entry), wanted[query]);
    if (distance > kMaxDistance) return;
    keep({entry.picture, entry.keypoint, query, distance}, nearest_[pair.query]);
  });
}

/// Inserts the hit into the sorted list of the nearest hits.
void TargetIndex::keep(const IndexHit& hit, std::vector<IndexHit>& nearest) const {
  const auto before = [](const IndexHit& a, const IndexHit& b) {
    if (a.distance != b.distance) return a.distance < b.distance;
    return a.picture != b.picture ? a.picture < b.picture : a.keypoint < b.keypoint;
  };
  const auto place = std::lower_bound(nearest.begin(), nearest.end(), hit, before);
  // If an equal entry is already at this place, another table has found the same hit before.
  if (place != nearest.end() && !before(hit, *place)) return;
  nearest.insert(place, hit);
  if (nearest.size() > kNearest) nearest.pop_back();
}

void FrameTables::setFrame(const std::vector<growth::Bits>& bits) {
  bits_ = bits;
  tables_.build(bits.size(), key_bits_,
                [&](std::size_t i) -> const growth::Bits& { return bits[i]; });
}

void FrameTables::match(std::uint32_t number, const growth::ReferenceFrames& picture,
                        std::vector<IndexHit>& pairs) {
  const std::vector<growth::Bits>& wanted = picture.bits();
  nearest_.assign(bits_.size(), {});
  // Searches one table at a time, because one table fits into the processor's first-level cache.
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

/// Updates `nearest` with a keypoint of the picture: the most similar keypoint so far, and the
/// distance of the most similar keypoint at another place.
void FrameTables::keep(std::uint32_t keypoint, int distance, const growth::ReferenceFrames& picture,
                       Nearest& nearest) const {
  constexpr float kApart = 8.F;  // px of the picture; a keypoint farther away is at another place
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
