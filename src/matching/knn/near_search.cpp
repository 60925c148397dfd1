#include "matching/knn/near_search.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

#include "homography/part_in_view.h"
#include "ktgp_orb/knn_matcher.h"
#include "util/divide.h"
#include "util/keypoint_position.h"

namespace ktgp_orb::knn {
namespace {

using util::ceilDivide;
using util::ThreadPool;

// Maximum number of runs of a query. Each row of cells gives at most one run, and a query touches
// fewer rows than this, even if rounding adds a row.
constexpr std::size_t kMaxRuns = 8;

constexpr int kQueriesPerChunk = 64;  // number of queries that a thread takes at a time
// Search radius divided by the side of a cell. Smaller cells give fewer useless candidates, but
// larger cells give longer runs.
constexpr double kCellsPerRadius = 2;
constexpr std::int32_t kFarthest = 8 * kDescriptorBytes;

/// Inverts the prediction: returns the homography from target to reference. Its sign is chosen so
/// that the third coordinate of a mapped point is positive where the target shows the plane.
Eigen::Matrix3d backwards(const Eigen::Matrix3d& prediction) {
  const Eigen::Matrix3d inverse = prediction.inverse();
  if (!prediction.allFinite() || !inverse.allFinite()) {
    throw std::invalid_argument(
        "the predicted homography cannot be inverted; expected a finite "
        "3x3 matrix of rank 3");
  }
  return homography::facing(inverse);
}

Correspondence fromKeys(const NearKeys& keys, std::int32_t number) {
  Correspondence c{-1, number, kFarthest, kFarthest, Level::knn, false};
  if (keys.best == kNoNearKey) return c;
  c.reference_index = keys.best & kNearIndexMask;
  c.distance = keys.best >> kNearIndexBits;
  c.second_distance = keys.second == kNoNearKey ? std::max(c.distance, kUnrelatedDistance)
                                                : keys.second >> kNearIndexBits;
  return c;
}

}  // namespace

void requireCountable(const Features& features, const std::string& name) {
  if (features.size() <= static_cast<std::size_t>(kMaxNearFeatures)) return;
  throw std::invalid_argument(name + " has " + std::to_string(features.size()) +
                              " keypoints; a search radius takes up to " +
                              std::to_string(kMaxNearFeatures));
}

void NearTable::layOut(const Features& features) {
  const std::size_t count = features.size();
  stride_ = ceilDivide(count, std::size_t{kMaxNearLanes}) * kMaxNearLanes + kMaxNearLanes;
  words_.resize(stride_ * kDescriptorWords);
  x_.resize(stride_);
  y_.resize(stride_);
  index_.resize(stride_);
  position_.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::int32_t index = cells_.order()[i];
    index_[i] = index;
    position_[static_cast<std::size_t>(index)] = static_cast<std::int32_t>(i);
    std::uint32_t words[kDescriptorWords];
    std::memcpy(words, features.descriptors.ptr(index), kDescriptorBytes);
    for (std::size_t w = 0; w < kDescriptorWords; ++w) words_[w * stride_ + i] = words[w];
  }
}

NearKeys NearTable::search(const KnnKernel& kernel, const std::uint8_t* descriptor,
                           const cv::Point2f& place, double radius, std::int32_t number,
                           std::int32_t* nearest_queries) const {
  // The reach is slightly larger than the radius, so that rounding does not exclude a candidate
  // that passes the test in single precision.
  const double reach = radius + 1e-3 + 1e-6 * (std::abs(place.x) + std::abs(place.y));
  std::array<NearRun, kMaxRuns> runs;
  std::size_t run_count = 0;
  cells_.visitRuns(place.x, place.y, reach, [&](std::uint32_t begin, std::uint32_t end) {
    if (begin == end) return;
    if (run_count == kMaxRuns) {
      // There is no room for another run, so the last run is extended over the gap. The kernel
      // excludes the candidates in the gap, because they are too far from the query.
      runs.back().end = end;
    } else {
      runs[run_count++] = {begin, end};
    }
  });
  const auto single = static_cast<float>(radius);
  const NearQuery query{descriptor,
                        place.x,
                        place.y,
                        single * single,
                        number,
                        runs.data(),
                        static_cast<int>(run_count)};
  const NearCandidates candidates{words_.data(), static_cast<std::ptrdiff_t>(stride_), x_.data(),
                                  y_.data(), index_.data()};
  return (nearest_queries != nullptr ? kernel.search_both_ways : kernel.search)(candidates, query,
                                                                                nearest_queries);
}

NearSearch::NearSearch(const KnnKernel& kernel, double radius, ThreadPool& pool)
    : kernel_(kernel),
      radius_(radius),
      pool_(pool),
      nearest_queries_(static_cast<std::size_t>(pool.threads())) {}

void NearSearch::match(const Features& reference, const Features& target,
                       const Eigen::Matrix3d& prediction, bool mutual,
                       std::vector<Correspondence>& correspondences) {
  requireCountable(reference, "reference");
  requireCountable(target, "target");
  correspondences.clear();
  if (reference.empty() || target.empty()) return;
  placeQueries(target, prediction);
  table_.build(
      reference, [&](std::size_t i) { return reference.keypoints[i].pt; }, reference.image_size,
      radius_ / kCellsPerRadius);
  correspondences.resize(target.size());
  const int chunks = ceilDivide(static_cast<int>(target.size()), kQueriesPerChunk);
  if (!mutual) {
    pool_.parallelFor(
        chunks, [&](int chunk) { searchChunk(target, chunk, nullptr, correspondences.data()); });
    return;
  }
  std::atomic<int> next_chunk{0};
  pool_.parallelFor(pool_.threads(), [&](int thread) {
    auto& nearest = nearest_queries_[static_cast<std::size_t>(thread)];
    nearest.assign(table_.columns(), kNoNearKey);
    for (int chunk = next_chunk++; chunk < chunks; chunk = next_chunk++) {
      searchChunk(target, chunk, nearest.data(), correspondences.data());
    }
  });
  markMutual(correspondences);
}

void NearSearch::placeQueries(const Features& target, const Eigen::Matrix3d& prediction) {
  const Eigen::Matrix3d h = backwards(prediction);
  places_.resize(target.size());
  for (std::size_t i = 0; i < target.size(); ++i) {
    const cv::Point2f& p = target.keypoints[i].pt;
    const Eigen::Vector3d u = h * Eigen::Vector3d(p.x, p.y, 1.0);
    // A keypoint beyond the horizon has no predicted position. It gets NaN, which is never within a
    // radius.
    const bool seen = u.z() > 0.0;
    places_[i].x = seen ? static_cast<float>(u.x() / u.z()) : std::nanf("");
    places_[i].y = seen ? static_cast<float>(u.y() / u.z()) : std::nanf("");
  }
  query_cells_.build(
      target.size(), [&](std::size_t i) { return places_[i]; }, target.image_size,
      radius_ / kCellsPerRadius);
}

void NearSearch::searchChunk(const Features& target, int chunk, std::int32_t* nearest_queries,
                             Correspondence* correspondences) const {
  const auto first = static_cast<std::size_t>(chunk) * kQueriesPerChunk;
  const std::size_t end = std::min(first + kQueriesPerChunk, target.size());
  for (std::size_t i = first; i < end; ++i) {
    const std::int32_t number = query_cells_.order()[i];
    const NearKeys keys =
        table_.search(kernel_, target.descriptors.ptr(number),
                      places_[static_cast<std::size_t>(number)], radius_, number, nearest_queries);
    correspondences[number] = fromKeys(keys, number);
  }
}

void NearSearch::markMutual(std::vector<Correspondence>& correspondences) {
  auto& nearest = nearest_queries_.front();
  for (std::size_t thread = 1; thread < nearest_queries_.size(); ++thread) {
    const auto& other = nearest_queries_[thread];
    for (std::size_t i = 0; i < table_.size(); ++i) nearest[i] = std::min(nearest[i], other[i]);
  }
  for (Correspondence& c : correspondences) {
    if (c.reference_index < 0) continue;
    c.mutual = (nearest[table_.column(c.reference_index)] & kNearIndexMask) == c.target_index;
  }
}

}  // namespace ktgp_orb::knn
