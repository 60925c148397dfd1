#include "matching/knn/index.h"

#include <algorithm>
#include <cstddef>

#include "matching/knn/kernel.h"
#include "util/divide.h"

namespace ktgp_orb::knn {
namespace {

using util::ceilDivide;

/// Writes the candidates of half group `h` of the reference into their lanes of `group`. Lanes
/// after the last candidate keep old bytes. This does no harm, since these lanes get the number
/// kNoKey, which makes their keys larger than any candidate's key.
void layOutHalfGroup(const cv::Mat& reference, int lanes, int h, std::uint8_t* group) {
  const std::ptrdiff_t row_bytes = std::ptrdiff_t{2} * lanes;
  const int half = h % 2;
  const int first = h * lanes;
  const int end = std::clamp(reference.rows, first, first + lanes);
  for (int candidate = first; candidate < end; ++candidate) {
    // Copy the descriptor to the stack. Then the compiler knows that writing the column does not
    // change it.
    std::uint8_t descriptor[kDescriptorBytes];
    std::copy_n(reference.ptr(candidate), kDescriptorBytes, descriptor);
    std::uint8_t* column = group + std::ptrdiff_t{2} * (candidate - first) + half;
    for (int b = 0; b < kDescriptorBytes; ++b) column[b * row_bytes] = descriptor[b];
  }
  auto* numbers = reinterpret_cast<std::int16_t*>(group + (kDescriptorBytes + half) * row_bytes);
  std::fill(numbers, numbers + (end - first), static_cast<std::int16_t>(h % (2 * kGroupsPerBlock)));
  std::fill(numbers + (end - first), numbers + lanes, kNoKey);
}

}  // namespace

std::ptrdiff_t KnnIndex::groupBytes() const {
  return std::ptrdiff_t{kRowsPerGroup} * 2 * lanes_;
}

void KnnIndex::setReference(const cv::Mat& reference) {
  const std::ptrdiff_t group_bytes = groupBytes();
  candidates_ = reference.rows;
  group_count_ = ceilDivide(candidates_, 2 * lanes_);
  const auto bytes = static_cast<std::size_t>(group_count_ * group_bytes);
  groups_.resize(ceilDivide(bytes, sizeof(CacheLine)));
  std::uint8_t* groups = groups_.front().bytes;
  for (int h = 0; h < 2 * group_count_; ++h) {
    layOutHalfGroup(reference, lanes_, h, groups + h / 2 * group_bytes);
  }
}

using util::ceilDivide;

void NearestQueries::reset(int candidates) {
  const auto count = static_cast<std::size_t>(candidates);
  keys_.resize(ceilDivide(count * sizeof(std::int16_t), sizeof(CacheLine)));
  std::fill_n(keys(), count, kNoKey);
  distance_.assign(count, kNoKey >> kKeyNumberBits);
  query_.assign(count, -1);
}

// The loops of the next two functions have no branch, so that the compiler can vectorise them.

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
