#pragma once

#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

#include "growth/local_frame.h"

namespace ktgp_orb::targets {

/// Finds the descriptors of a set that are similar to a given descriptor, without comparing them
/// all. A descriptor has eight parts of 32 bits. For each part, a table sorts the descriptors by a
/// key, the first bits of this part (multi-index hashing: Norouzi, Punjani & Fleet, CVPR 2012).
/// Reuses its buffers.
class BitTables {
 public:
  static constexpr std::size_t kTables = 8;
  static constexpr int kMaxKeyBits = 20;

  /// `fullest_cell`: if more descriptors than this have the same key, find() skips them, because
  /// such a frequent key says little. `most_other_bits`: find() compares 32 bits outside the key,
  /// too, and skips a descriptor if more of them differ.
  BitTables(std::uint32_t fullest_cell, int most_other_bits)
      : fullest_cell_(fullest_cell), most_other_bits_(most_other_bits) {}

  /// Sorts `count` descriptors into the tables. `bits_of(i)`: returns descriptor number i.
  /// `key_bits`: length of a key, 8..kMaxKeyBits; with shorter keys, find() finds more descriptors
  /// and takes longer.
  template <typename BitsOf>
  void build(std::size_t count, int key_bits, BitsOf bits_of) {
    key_bits_ = key_bits;
    for (std::size_t t = 0; t < kTables; ++t) {
      Table& table = tables_[t];
      table.start.assign((std::size_t{1} << key_bits) + 1, 0);
      for (std::size_t i = 0; i < count; ++i) {
        ++table.start[keyOf(bits_of(i), t)];
      }
      std::partial_sum(table.start.begin(), table.start.end(), table.start.begin());
      table.items.resize(count);
      // At this point, `start` holds the ends of the cells. Each item decrements the end of its
      // cell, so that `start` holds the beginnings of the cells afterwards. The loop goes backwards
      // so that the items of a cell keep their order.
      for (std::size_t i = count; i-- > 0;) {
        table.items[--table.start[keyOf(bits_of(i), t)]] = {static_cast<std::uint32_t>(i),
                                                            otherBits(bits_of(i), t)};
      }
    }
  }

  struct Item {
    std::uint32_t number;
    std::uint32_t some_bits;  // 32 bits outside the key; a fast test of them rejects most items
  };
  struct Similar {
    std::uint32_t query;
    std::uint32_t item;
  };
  /// Result and buffers of find(). The caller owns them, so that several BitTables can share them.
  struct Found {
    std::vector<Similar> pairs;
    std::size_t count = 0;  // only the first `count` pairs are valid

    struct Run {
      std::uint32_t query, others, begin, end;
      const Item* items;
    };
    std::vector<Run> runs;
  };

  /// For each query, finds the descriptors that have the same key in one of the tables [`first`,
  /// `end`) and differ in few other bits. `queries`: number of queries. `wanted_of(q)`: returns the
  /// descriptor of query number q. Works in steps; each step prefetches the memory that the next
  /// step reads.
  template <typename WantedOf>
  void find(std::size_t first, std::size_t end, std::size_t queries, WantedOf wanted_of,
            Found& found) const {
    std::vector<typename Found::Run>& runs = found.runs;
    runs.clear();
    for (std::uint32_t q = 0; q < queries; ++q) {
      for (std::size_t t = first; t < end; ++t) {
        const std::uint32_t key = keyOf(wanted_of(q), t);
        __builtin_prefetch(&tables_[t].start[key]);
        runs.push_back({q, otherBits(wanted_of(q), t), key, 0, tables_[t].items.data()});
      }
    }
    std::size_t t = first, used = 0, items = 0;
    for (const typename Found::Run run : runs) {
      const std::uint32_t* start = &tables_[t].start[run.begin];
      if (++t == end) t = first;
      const std::uint32_t length = start[1] - start[0];
      // No branch here: empty cells are distributed at random, so the processor would often
      // mispredict a branch.
      runs[used] = {run.query, run.others, start[0], start[1], run.items};
      const bool is_used = length > 0 && length <= fullest_cell_;
      used += static_cast<std::size_t>(is_used);
      items += is_used ? length : 0;
      __builtin_prefetch(run.items + start[0]);
    }
    if (found.pairs.size() < items + 1) found.pairs.resize(items + 1);
    found.count = 0;
    for (std::size_t r = 0; r < used; ++r) {
      const typename Found::Run& run = runs[r];
      for (std::uint32_t i = run.begin; i < run.end; ++i) {
        found.pairs[found.count] = {run.query, run.items[i].number};
        found.count += static_cast<std::size_t>(
            growth::countBits(run.items[i].some_bits ^ run.others) <= most_other_bits_);
      }
    }
  }

 private:
  struct Table {
    // For each key, the index of its first item. The last entry is the number of items.
    std::vector<std::uint32_t> start;
    std::vector<Item> items;
  };

  std::uint32_t keyOf(const growth::Bits& bits, std::size_t table) const {
    return static_cast<std::uint32_t>(bits[table / 2] >> (32 * (table % 2))) &
           ((1U << key_bits_) - 1U);
  }
  /// The middle 32 bits of the 64-bit word that follows the word with the key.
  static std::uint32_t otherBits(const growth::Bits& bits, std::size_t table) {
    return static_cast<std::uint32_t>(bits[(table / 2 + 1) % bits.size()] >> 16);
  }

  std::uint32_t fullest_cell_;
  int most_other_bits_;
  int key_bits_ = 0;
  Table tables_[kTables];
};

}  // namespace ktgp_orb::targets
