#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::knn {

/// A block of memory that is aligned for the widest vector.
struct alignas(64) CacheLine {
  std::uint8_t bytes[64];
};

/// Collects the nearest query of each candidate, for the search in the other direction. The queries
/// come in chunks, and each thread has its own object. At equal distances, the query with the lower
/// number wins.
class NearestQueries {
 public:
  /// Resets all candidates to "no query". `candidates`: their number, a multiple of 32.
  void reset(int candidates);

  /// The keys of the current chunk (see kernel.h), one per candidate.
  std::int16_t* keys() { return reinterpret_cast<std::int16_t*>(keys_.front().bytes); }
  /// Updates the nearest queries with the keys of the chunk that begins with query `first_query`,
  /// and resets the keys. Each thread must process its chunks in ascending order.
  void takeChunk(int first_query);
  /// Merges the result of another thread.
  void take(const NearestQueries& other);

  /// The query nearest to the candidate; -1 if there is none.
  int query(int candidate) const { return query_[static_cast<std::size_t>(candidate)]; }

 private:
  std::vector<CacheLine> keys_;
  std::vector<std::int32_t> distance_;
  std::vector<std::int32_t> query_;
};

/// The descriptors of a reference in the layout of kernel.h, for the search in the whole image.
class KnnIndex {
 public:
  /// `lanes`: see KnnKernel::lanes.
  explicit KnnIndex(int lanes) : lanes_(lanes) {}

  /// `reference`: descriptors, not empty.
  void setReference(const cv::Mat& reference);

  int candidates() const { return candidates_; }
  int groupCount() const { return group_count_; }
  std::ptrdiff_t groupBytes() const;
  const std::uint8_t* group(int i) const { return groups_.front().bytes + i * groupBytes(); }

 private:
  int lanes_;
  int candidates_ = 0;  // number of reference descriptors
  int group_count_ = 0;
  std::vector<CacheLine> groups_;
};

}  // namespace ktgp_orb::knn
