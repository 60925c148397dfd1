#include "targets/target_index.h"

#include <algorithm>
#include <utility>

#include "core/util/random.h"

namespace ktgp_orb::targets {
namespace {

constexpr int kMinKeyBits = 8;
// Cells with more items are skipped: many pictures have these bits, so they say little.
constexpr std::uint32_t kFullest = 48;
constexpr int kMostOtherBits = 8;  // of the 32 bits that are not part of the key, may differ

std::uint32_t otherBits(const growth::Bits& bits, int table) {
  return static_cast<std::uint32_t>(bits[static_cast<std::size_t>(table) % bits.size()] >> 16);
}

}  // namespace

TargetIndex::TargetIndex() {
  util::Random random(1);
  for (auto& table : places_) {
    for (std::size_t i = 0; i < kMaxKeyBits; ++i) {
      do {
        table[i] = static_cast<std::uint8_t>(random.below(256));
      } while (std::find(table, table + i, table[i]) != table + i);
    }
  }
}

std::uint32_t TargetIndex::keyOf(const growth::Bits& bits, int table, int key_bits) const {
  std::uint32_t key = 0;
  for (int i = 0; i < key_bits; ++i) {
    const std::uint8_t place = places_[table][i];
    key = key << 1 | static_cast<std::uint32_t>(bits[place >> 6] >> (place & 63) & 1);
  }
  return key;
}

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
  // Segments that are not larger are merged with the new one, as a binary counter carries. So each
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
  // Targets that change all the time do not make it grow, either.
  if (removed_ > largest || (kOneIn * others > largest && !was_changing)) mergeFrom(0);
}

/// The segments from `first` on become one, in which all entries are sorted by picture.
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
  build(merged);
  segments_.push_back(std::move(merged));
}

void TargetIndex::build(Segment& segment) const {
  segment.key_bits = kMinKeyBits;
  while (segment.key_bits < kMaxKeyBits &&
         std::size_t{1} << segment.key_bits < segment.entries.size()) {
    ++segment.key_bits;
  }
  const std::size_t keys = std::size_t{1} << segment.key_bits;
  std::vector<std::uint32_t> key_of(segment.entries.size());
  for (int t = 0; t < kTables; ++t) {
    Table& table = segment.tables[t];
    table.start.assign(keys + 1, 0);
    for (std::size_t e = 0; e < key_of.size(); ++e) {
      key_of[e] = keyOf(bitsOf(segment.entries[e]), t, segment.key_bits);
      ++table.start[key_of[e]];
    }
    std::uint32_t sum = 0;
    for (std::uint32_t& start : table.start) {
      sum += start;
      start = sum;
    }
    table.items.resize(key_of.size());
    // As in FrameTables: the ends of the cells become their beginnings.
    for (std::size_t e = key_of.size(); e-- > 0;) {
      table.items[--table.start[key_of[e]]] = {static_cast<std::uint32_t>(e),
                                               otherBits(bitsOf(segment.entries[e]), t)};
    }
  }
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

/// Works in steps; each one fetches the memory that the next one needs.
void TargetIndex::searchSegment(const Segment& segment, const std::vector<growth::Bits>& wanted,
                                const std::uint32_t* queries, std::size_t count) {
  keys_.clear();
  for (std::size_t i = 0; i < count; ++i) {
    for (int t = 0; t < kTables; ++t) {
      keys_.push_back(keyOf(wanted[queries[i]], t, segment.key_bits));
      __builtin_prefetch(&segment.tables[t].start[keys_.back()]);
    }
  }
  runs_.clear();
  for (std::size_t i = 0; i < keys_.size(); ++i) {
    const Table& table = segment.tables[i % kTables];
    Run run{table.start[keys_[i]], table.start[keys_[i] + 1]};
    if (run.end - run.begin > kFullest) run.end = run.begin;
    __builtin_prefetch(table.items.data() + run.begin);
    runs_.push_back(run);
  }
  near_.clear();
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    const std::size_t place = i / kTables;
    const Table& table = segment.tables[i % kTables];
    const std::uint32_t others = otherBits(wanted[queries[place]], static_cast<int>(i % kTables));
    for (std::uint32_t k = runs_[i].begin; k < runs_[i].end; ++k) {
      const Item& item = table.items[k];
      if (growth::countBits(item.some_bits ^ others) > kMostOtherBits) continue;
      near_.push_back({item.entry, static_cast<std::uint32_t>(place), nullptr});
      __builtin_prefetch(&segment.entries[item.entry]);
    }
  }
  for (Near& near : near_) {
    const Entry& entry = segment.entries[near.entry];
    if (pictures_[entry.picture] == nullptr) continue;
    near.bits = &bitsOf(entry);
    __builtin_prefetch(near.bits);
  }
  for (const Near& near : near_) {
    if (near.bits == nullptr) continue;
    const std::uint32_t query = queries[near.place];
    const int distance = growth::distance(*near.bits, wanted[query]);
    if (distance > kMaxDistance) continue;
    const Entry& entry = segment.entries[near.entry];
    keep({entry.picture, entry.keypoint, query, distance}, nearest_[near.place]);
  }
}

/// Inserts the hit among the nearest ones, which are kept in order.
void TargetIndex::keep(const IndexHit& hit, std::vector<IndexHit>& nearest) const {
  const auto before = [](const IndexHit& a, const IndexHit& b) {
    if (a.distance != b.distance) return a.distance < b.distance;
    return a.picture != b.picture ? a.picture < b.picture : a.keypoint < b.keypoint;
  };
  const auto place = std::lower_bound(nearest.begin(), nearest.end(), hit, before);
  if (place != nearest.end() && !before(hit, *place)) return;  // it was found in another table, too
  nearest.insert(place, hit);
  if (nearest.size() > kNearest) nearest.pop_back();
}

}  // namespace ktgp_orb::targets
