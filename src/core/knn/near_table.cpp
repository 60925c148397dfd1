#include "core/knn/near_table.h"

#include <array>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "core/util/divide.h"

namespace ktgp_orb::knn {
namespace {

using util::ceilDivide;

constexpr std::size_t kMaxRuns = 8;  // a query touches fewer rows of cells; rounding may add one

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

NearKeys NearTable::search(const NearKernel& kernel, const std::uint8_t* descriptor,
                           const cv::Point2f& place, double radius, std::int32_t number,
                           std::int32_t* nearest_queries) const {
  // Slightly larger, so that rounding excludes no candidate that passes the test in single
  // precision.
  const double reach = radius + 1e-3 + 1e-6 * (std::abs(place.x) + std::abs(place.y));
  std::array<NearRun, kMaxRuns> runs;
  std::size_t run_count = 0;
  cells_.visitRuns(place.x, place.y, reach, [&](std::uint32_t begin, std::uint32_t end) {
    if (begin == end) return;
    if (run_count == kMaxRuns) {
      runs.back().end = end;  // the candidates in between are too far away, and are excluded later
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

}  // namespace ktgp_orb::knn
