#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace ktgp_orb::util {

/// Sorts the numbers 0 .. n - 1 by bucket (a counting sort); numbers in one bucket stay ascending.
/// Keeps its buffers.
class Buckets {
 public:
  /// Sorts the numbers 0 .. count - 1. `bucket_of(i)`: index of the bucket of number i, below
  /// `buckets`.
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
    // Filling from the back moves start_ from the end of each bucket to its beginning.
    order_.resize(count);
    for (std::size_t i = count; i-- > 0;) {
      order_[--start_[bucket_[i]]] = static_cast<std::int32_t>(i);
    }
  }

  /// The sorted numbers, bucket by bucket.
  const std::vector<std::int32_t>& order() const { return order_; }
  /// Index in order() at which a bucket begins or ends. begin() also accepts the number of buckets,
  /// and then returns the end of the last bucket.
  std::uint32_t begin(std::size_t bucket) const { return start_[bucket]; }
  std::uint32_t end(std::size_t bucket) const { return start_[bucket + 1]; }

 private:
  std::vector<std::uint32_t> bucket_;  // index of the bucket of each number
  std::vector<std::uint32_t> start_;
  std::vector<std::int32_t> order_;
};

}  // namespace ktgp_orb::util
