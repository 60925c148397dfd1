#include "core/prosac/points.h"

#include <array>
#include <cstring>
#include <numeric>
#include <utility>

namespace ktgp_orb {
namespace {

constexpr int kIndexBits = 32;
constexpr std::uint64_t kIndexMask = 0xffffffffU;

/// An integer that orders as the number does in single precision, which tells all ratios of Hamming
/// distances apart.
std::uint64_t sortKey(double quality) {
  const float single = static_cast<float>(quality) + 0.0F;  // -0 becomes 0
  std::uint32_t bits = 0;
  std::memcpy(&bits, &single, sizeof bits);
  const bool negative = (bits >> 31) != 0;
  return bits ^ (negative ? 0xffffffffU : 0x80000000U);
}

}  // namespace

/// Radix sort, byte by byte from the lowest: stable, and several times faster than comparing.
void ProsacPoints::sortByQuality(const std::vector<double>& quality) {
  const std::size_t n = quality.size();
  order_.resize(n);
  sorted_.resize(n);
  for (std::size_t i = 0; i < n; ++i) order_[i] = sortKey(quality[i]) << kIndexBits | i;
  for (int shift = kIndexBits; shift < 64; shift += 8) {
    std::array<std::size_t, 257> start{};
    for (const std::uint64_t key : order_) ++start[(key >> shift & 0xffU) + 1];
    std::partial_sum(start.begin(), start.end(), start.begin());
    for (const std::uint64_t key : order_) sorted_[start[key >> shift & 0xffU]++] = key;
    std::swap(order_, sorted_);
  }
}

void ProsacPoints::load(const PointPairs& pairs, double threshold) {
  const std::size_t n = pairs.size();
  sortByQuality(pairs.quality);
  reference = Normalisation::of(pairs.reference);
  target = Normalisation::of(pairs.target);
  limit = threshold * target.scale;
  min_target_area = limit * limit;
  min_reference_area = threshold * threshold * reference.scale * reference.scale;
  scoring.resize(n);
  refinement.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t index = order_[i] & kIndexMask;
    const Eigen::Vector2d x = reference.apply(pairs.reference[index]);
    const Eigen::Vector2d u = target.apply(pairs.target[index]);
    scoring.set(i, x, u);
    refinement.set(i, x, u);
  }
}

}  // namespace ktgp_orb
