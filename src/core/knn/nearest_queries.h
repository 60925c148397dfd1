#pragma once

#include <cstdint>
#include <vector>

namespace ktgp_orb::knn {

/// Memory aligned to the widest vector.
struct alignas(64) CacheLine {
  std::uint8_t bytes[64];
};

/// The other direction of the search: the query nearest to each candidate, collected from the
/// chunks of queries of one thread. For equal distances, the lower query.
class NearestQueries {
 public:
  /// Resets all candidates to "no query". `candidates` is a multiple of 32.
  void reset(int candidates);

  /// The keys of the current chunk (see kernel.h), one per candidate.
  std::int16_t* keys() { return reinterpret_cast<std::int16_t*>(keys_.front().bytes); }
  /// Collects the keys of the chunk whose first query is `first_query`, and clears them. The chunks
  /// of a thread come in ascending order.
  void takeChunk(int first_query);
  /// Merges the result of another thread.
  void take(const NearestQueries& other);

  /// -1 if there is none.
  int query(int candidate) const { return query_[static_cast<std::size_t>(candidate)]; }

 private:
  std::vector<CacheLine> keys_;
  std::vector<std::int32_t> distance_;
  std::vector<std::int32_t> query_;
};

}  // namespace ktgp_orb::knn
