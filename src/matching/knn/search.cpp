#include "matching/knn/search.h"

#include <algorithm>
#include <atomic>
#include <cstddef>

#include "ktgp_orb/features.h"
#include "util/divide.h"

namespace ktgp_orb::knn {
namespace {

// Number of queries that a thread takes at a time. It is large enough that a block of candidates,
// once in the cache, is used many times, and small enough that the work of a frame can be divided
// evenly among the threads.
constexpr int kQueriesPerChunk = 64;
static_assert(kQueriesPerChunk <= kMaxQueriesPerChunk && kQueriesPerChunk % kQueriesPerPass == 0);

constexpr int kNoDistance = kNoKey >> kKeyNumberBits;  // larger than every distance

std::int16_t minimum(const std::int16_t* keys, int lanes) {
  std::int16_t smallest = kNoKey;
  for (int i = 0; i < lanes; ++i) smallest = std::min(smallest, keys[i]);
  return smallest;
}

/// Merges the lanes of one block into the best two candidates so far. Blocks are merged in the
/// order of their candidates, so at equal distances the existing candidate has the lower index.
void merge(LaneKeys& keys, int lanes, int first_half_group, Correspondence& c) {
  const std::int16_t nearest = minimum(keys.best, lanes);
  const int distance = nearest >> kKeyNumberBits;
  if (distance >= c.second_distance) return;
  if (distance >= c.distance) {
    c.second_distance = distance;
    return;
  }
  // A key contains the half group, so candidates with equal keys belong to the same half group (see
  // kernel.h). Of these, the first lane holds the candidate with the lowest index.
  const auto lane = std::find(keys.best, keys.best + lanes, nearest) - keys.best;
  keys.best[lane] = keys.second[lane];
  c.second_distance = std::min(c.distance, minimum(keys.best, lanes) >> kKeyNumberBits);
  c.distance = distance;
  const int half_group = first_half_group + (nearest & ((1 << kKeyNumberBits) - 1));
  c.reference_index = half_group * lanes + static_cast<int>(lane);
}

}  // namespace

KnnSearch::KnnSearch(const KnnKernel& kernel, int threads)
    : kernel_(kernel), pool_(threads), index_(kernel.lanes), nearest_queries_(pool_.threads()) {}

void KnnSearch::match(const cv::Mat& reference, const cv::Mat& target, bool mutual,
                      std::vector<Correspondence>& correspondences) {
  requireDescriptors(reference, "reference");
  requireDescriptors(target, "target");
  correspondences.clear();
  if (reference.empty() || target.empty()) return;
  index_.setReference(reference);
  correspondences.resize(static_cast<std::size_t>(target.rows));
  const int chunks = util::ceilDivide(target.rows, kQueriesPerChunk);
  if (!mutual) {
    pool_.parallelFor(
        chunks, [&](int chunk) { searchChunk(target, chunk, correspondences.data(), nullptr); });
    return;
  }
  std::atomic<int> next_chunk{0};
  pool_.parallelFor(pool_.threads(), [&](int thread) {
    NearestQueries& nearest = nearest_queries_[static_cast<std::size_t>(thread)];
    nearest.reset(index_.groupCount() * 2 * kernel_.lanes);
    for (int chunk = next_chunk++; chunk < chunks; chunk = next_chunk++) {
      searchChunk(target, chunk, correspondences.data(), &nearest);
      nearest.takeChunk(chunk * kQueriesPerChunk);
    }
  });
  NearestQueries& nearest = nearest_queries_.front();
  for (std::size_t i = 1; i < nearest_queries_.size(); ++i) nearest.take(nearest_queries_[i]);
  for (Correspondence& c : correspondences) {
    c.mutual = nearest.query(c.reference_index) == c.target_index;
  }
}

void KnnSearch::searchChunk(const cv::Mat& target, int chunk, Correspondence* correspondences,
                            NearestQueries* nearest_queries) {
  const int first = chunk * kQueriesPerChunk;
  const int end = std::min(first + kQueriesPerChunk, target.rows);
  for (int t = first; t < end; ++t) {
    correspondences[t] = {-1, t, kNoDistance, kNoDistance, Level::knn, false};
  }
  const KnnKernel::Scan scan = nearest_queries != nullptr ? kernel_.scan_both_ways : kernel_.scan;
  for (int g = 0; g < index_.groupCount(); g += kGroupsPerBlock) {
    const std::uint8_t* block = index_.group(g);
    std::int16_t* nearest_keys =
        nearest_queries != nullptr ? nearest_queries->keys() + std::ptrdiff_t{2} * g * kernel_.lanes
                                   : nullptr;
    for (int t = first; t < end; t += kQueriesPerPass) {
      QueryPass queries;
      queries.first_number = t - first;
      for (int q = 0; q < kQueriesPerPass; ++q) {
        queries.descriptor[q] =
            target.ptr(std::min(t + q, end - 1));  // the last query is repeated to fill the pass
      }
      LaneKeys keys[kQueriesPerPass];
      scan(block, std::min(kGroupsPerBlock, index_.groupCount() - g), queries, keys, nearest_keys);
      for (int q = 0; q < std::min(kQueriesPerPass, end - t); ++q) {
        merge(keys[q], kernel_.lanes, 2 * g, correspondences[t + q]);
      }
    }
  }
  if (index_.candidates() > 1) return;
  for (int t = first; t < end; ++t)
    correspondences[t].second_distance = 0;  // a single candidate has no second neighbour
}

}  // namespace ktgp_orb::knn
