#pragma once

#include <cstdint>
#include <vector>

namespace ktgp_orb::knn {

/// Memory aligned to the widest vector.
struct alignas(64) CacheLine {
  std::uint8_t bytes[64];
};

/// The other direction of the search: the query nearest to each candidate, gathered from the
/// chunks of queries that one thread has searched for. Equal distances: the lower query.
class NearestQueries {
 public:
  /// No query yet for any of the candidates, of which there are a multiple of 32.
  void reset(int candidates);

  /// The keys that a chunk of queries lowers (see kernel.h), one for each candidate.
  std::int16_t* keys() { return reinterpret_cast<std::int16_t*>(keys_.front().bytes); }
  /// Takes over the keys of the chunk whose first query is `first_query` and clears them. The
  /// chunks of a thread come in ascending order.
  void takeChunk(int first_query);
  /// Takes over what another thread has found.
  void take(const NearestQueries& other);

  /// -1 where there is none.
  int query(int candidate) const { return query_[static_cast<std::size_t>(candidate)]; }

 private:
  std::vector<CacheLine> keys_;
  std::vector<std::int32_t> distance_;
  std::vector<std::int32_t> query_;
};

}  // namespace ktgp_orb::knn
