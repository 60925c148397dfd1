#include "core/knn/search.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <utility>

#include "core/util/divide.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb::knn {
namespace {

using util::ceilDivide;

// Queries that one thread takes at a time: enough to read a block from the cache many times over,
// few enough to divide a frame evenly.
constexpr int kQueriesPerChunk = 64;
static_assert(kQueriesPerChunk <= kMaxQueriesPerChunk && kQueriesPerChunk % kQueriesPerPass == 0);

constexpr int kNoDistance = kNoKey >> kKeyNumberBits;  // above any distance

std::ptrdiff_t groupBytes(const KnnKernel& kernel) {
  return std::ptrdiff_t{kRowsPerGroup} * 2 * kernel.lanes;
}

/// Writes the candidates of half group `h` of the frame into their lanes of `group`. Lanes beyond
/// the last candidate keep whatever bytes they had: their number hides them.
void layOutHalfGroup(const cv::Mat& reference, int lanes, int h, std::uint8_t* group) {
  const std::ptrdiff_t row_bytes = std::ptrdiff_t{2} * lanes;
  const int half = h % 2;
  const int first = h * lanes;
  const int end = std::clamp(reference.rows, first, first + lanes);
  for (int candidate = first; candidate < end; ++candidate) {
    std::uint8_t descriptor[kDescriptorBytes];  // a copy, which writing the column cannot change
    std::copy_n(reference.ptr(candidate), kDescriptorBytes, descriptor);
    std::uint8_t* column = group + std::ptrdiff_t{2} * (candidate - first) + half;
    for (int b = 0; b < kDescriptorBytes; ++b) column[b * row_bytes] = descriptor[b];
  }
  auto* numbers = reinterpret_cast<std::int16_t*>(group + (kDescriptorBytes + half) * row_bytes);
  std::fill(numbers, numbers + (end - first), static_cast<std::int16_t>(h % (2 * kGroupsPerBlock)));
  std::fill(numbers + (end - first), numbers + lanes, kNoKey);
}

std::int16_t minimum(const std::int16_t* keys, int lanes) {
  std::int16_t smallest = kNoKey;
  for (int i = 0; i < lanes; ++i) smallest = std::min(smallest, keys[i]);
  return smallest;
}

/// Folds the lanes of one block into the best two so far. Blocks come in the order of their
/// candidates, so that at equal distance what is there already has the lower index.
void merge(LaneKeys& keys, int lanes, int first_half_group, Correspondence& c) {
  const std::int16_t nearest = minimum(keys.best, lanes);
  const int distance = nearest >> kKeyNumberBits;
  if (distance >= c.second_distance) return;
  if (distance >= c.distance) {
    c.second_distance = distance;
    return;
  }
  // Equal keys are neighbours of one half group: the first lane has the lower index.
  const auto lane = std::find(keys.best, keys.best + lanes, nearest) - keys.best;
  keys.best[lane] = keys.second[lane];
  c.second_distance = std::min(c.distance, minimum(keys.best, lanes) >> kKeyNumberBits);
  c.distance = distance;
  const int half_group = first_half_group + (nearest & ((1 << kKeyNumberBits) - 1));
  c.reference_index = half_group * lanes + static_cast<int>(lane);
}

}  // namespace

KnnSearch::KnnSearch(const KnnKernel& kernel, int threads)
    : kernel_(kernel), pool_(threads), nearest_queries_(pool_.threads()) {}

void KnnSearch::match(const cv::Mat& reference, const cv::Mat& target,
                      std::vector<Correspondence>& correspondences) {
  if (!prepare(reference, target, correspondences)) return;
  pool_.parallelFor(ceilDivide(target.rows, kQueriesPerChunk), [&](int chunk) {
    searchChunk(target, chunk, correspondences.data(), nullptr);
  });
}

void KnnSearch::matchMutual(const cv::Mat& reference, const cv::Mat& target,
                            std::vector<Correspondence>& correspondences) {
  if (!prepare(reference, target, correspondences)) return;
  const int chunks = ceilDivide(target.rows, kQueriesPerChunk);
  std::atomic<int> next_chunk{0};
  pool_.parallelFor(pool_.threads(), [&](int thread) {
    NearestQueries& nearest = nearest_queries_[static_cast<std::size_t>(thread)];
    nearest.reset(group_count_ * 2 * kernel_.lanes);
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

bool KnnSearch::prepare(const cv::Mat& reference, const cv::Mat& target,
                        std::vector<Correspondence>& correspondences) {
  requireDescriptors(reference, "reference");
  requireDescriptors(target, "target");
  correspondences.clear();
  const bool kept = std::exchange(keep_reference_, false) && candidates_ == reference.rows;
  if (!kept) candidates_ = 0;
  if (reference.empty() || target.empty()) return false;
  if (!kept) layOut(reference);
  correspondences.resize(static_cast<std::size_t>(target.rows));
  return true;
}

void KnnSearch::layOut(const cv::Mat& reference) {
  const std::ptrdiff_t group_bytes = groupBytes(kernel_);
  candidates_ = reference.rows;
  group_count_ = ceilDivide(candidates_, 2 * kernel_.lanes);
  const auto bytes = static_cast<std::size_t>(group_count_ * group_bytes);
  groups_.resize(ceilDivide(bytes, sizeof(CacheLine)));
  std::uint8_t* groups = groups_.front().bytes;
  for (int h = 0; h < 2 * group_count_; ++h) {
    layOutHalfGroup(reference, kernel_.lanes, h, groups + h / 2 * group_bytes);
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
  for (int g = 0; g < group_count_; g += kGroupsPerBlock) {
    const std::uint8_t* block = groups_.front().bytes + g * groupBytes(kernel_);
    std::int16_t* nearest_keys =
        nearest_queries != nullptr ? nearest_queries->keys() + std::ptrdiff_t{2} * g * kernel_.lanes
                                   : nullptr;
    for (int t = first; t < end; t += kQueriesPerPass) {
      QueryPass queries;
      queries.first_number = t - first;
      for (int q = 0; q < kQueriesPerPass; ++q) {
        queries.descriptor[q] = target.ptr(std::min(t + q, end - 1));  // the last fills up the pass
      }
      LaneKeys keys[kQueriesPerPass];
      scan(block, std::min(kGroupsPerBlock, group_count_ - g), queries, keys, nearest_keys);
      for (int q = 0; q < std::min(kQueriesPerPass, end - t); ++q) {
        merge(keys[q], kernel_.lanes, 2 * g, correspondences[t + q]);
      }
    }
  }
  if (candidates_ > 1) return;
  for (int t = first; t < end; ++t) correspondences[t].second_distance = 0;  // there is no second
}

}  // namespace ktgp_orb::knn
