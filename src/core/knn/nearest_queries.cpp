#include "core/knn/nearest_queries.h"

#include <algorithm>
#include <cstddef>

#include "core/knn/kernel.h"
#include "core/util/divide.h"

namespace ktgp_orb::knn {

using util::ceilDivide;

void NearestQueries::reset(int candidates) {
  const auto count = static_cast<std::size_t>(candidates);
  keys_.resize(ceilDivide(count * sizeof(std::int16_t), sizeof(CacheLine)));
  std::fill_n(keys(), count, kNoKey);
  distance_.assign(count, kNoKey >> kKeyNumberBits);
  query_.assign(count, -1);
}

// The two loops have no branch, so that the compiler can vectorise them.

void NearestQueries::takeChunk(int first_query) {
  std::int16_t* key = keys();
  std::int32_t* distance = distance_.data();
  std::int32_t* query = query_.data();
  const std::size_t count = query_.size();
  for (std::size_t c = 0; c < count; ++c) {
    const int new_distance = key[c] >> kKeyNumberBits;
    const int new_query = first_query + (key[c] & (kMaxQueriesPerChunk - 1));
    const bool nearer = new_distance < distance[c];
    query[c] = nearer ? new_query : query[c];
    distance[c] = nearer ? new_distance : distance[c];
    key[c] = kNoKey;
  }
}

void NearestQueries::take(const NearestQueries& other) {
  const std::size_t count = query_.size();
  for (std::size_t c = 0; c < count; ++c) {
    const bool equal = other.distance_[c] == distance_[c];
    const bool nearer = equal ? other.query_[c] < query_[c] : other.distance_[c] < distance_[c];
    query_[c] = nearer ? other.query_[c] : query_[c];
    distance_[c] = nearer ? other.distance_[c] : distance_[c];
  }
}

}  // namespace ktgp_orb::knn
