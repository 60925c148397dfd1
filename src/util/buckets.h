#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace ktgp_orb::util {

/// Sorts the numbers 0 .. n - 1 into buckets (a counting sort). Within a bucket, the numbers stay
/// ascending. The next sort uses the same memory.
class Buckets {
 public:
  /// Sorts the numbers 0 .. count - 1. `bucket_of(i)`: returns the bucket of number i, in [0,
  /// buckets).
  template <typename BucketOf>
  void sort(std::size_t count, std::size_t buckets, const BucketOf& bucket_of) {
    bucket_.resize(count);
    start_.assign(buckets + 1, 0);
    for (std::size_t i = 0; i < count; ++i) {
      bucket_[i] = static_cast<std::uint32_t>(bucket_of(i));
      ++start_[bucket_[i]];
    }
    std::uint32_t sum = 0;
    for (std::uint32_t& start : start_) start = sum += start;
    // Now start_ holds the end of each bucket. The buckets are filled from their ends, so that
    // start_ holds their beginnings afterwards.
    order_.resize(count);
    for (std::size_t i = count; i-- > 0;) {
      order_[--start_[bucket_[i]]] = static_cast<std::int32_t>(i);
    }
  }

  /// The sorted numbers, bucket by bucket.
  const std::vector<std::int32_t>& order() const { return order_; }
  /// Positions in order() where a bucket begins and ends. begin(number of buckets) is allowed, too:
  /// it is the end of the last bucket.
  std::uint32_t begin(std::size_t bucket) const { return start_[bucket]; }
  std::uint32_t end(std::size_t bucket) const { return start_[bucket + 1]; }

 private:
  std::vector<std::uint32_t> bucket_;  // index of the bucket of each number
  std::vector<std::uint32_t> start_;
  std::vector<std::int32_t> order_;
};

}  // namespace ktgp_orb::util
