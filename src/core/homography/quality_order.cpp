#include "core/homography/quality_order.h"

#include <array>
#include <cstring>
#include <numeric>
#include <utility>

namespace ktgp_orb::homography {
namespace {

/// An integer with the same order as the number in single precision, which separates all ratios of
/// Hamming distances.
std::uint64_t sortKey(double quality) {
  const float single = static_cast<float>(quality) + 0.0F;  // -0 becomes 0
  std::uint32_t bits = 0;
  std::memcpy(&bits, &single, sizeof bits);
  const bool negative = (bits >> 31) != 0;
  return bits ^ (negative ? 0xffffffffU : 0x80000000U);
}

}  // namespace

/// Radix sort, from the lowest byte on: stable, and several times faster than comparing.
void QualityOrder::sort(const std::vector<double>& quality) {
  const std::size_t n = quality.size();
  keys_.resize(n);
  sorted_.resize(n);
  for (std::size_t i = 0; i < n; ++i) keys_[i] = sortKey(quality[i]) << kIndexBits | i;
  for (int shift = kIndexBits; shift < 64; shift += 8) {
    std::array<std::size_t, 257> start{};
    for (const std::uint64_t key : keys_) ++start[(key >> shift & 0xffU) + 1];
    std::partial_sum(start.begin(), start.end(), start.begin());
    for (const std::uint64_t key : keys_) sorted_[start[key >> shift & 0xffU]++] = key;
    std::swap(keys_, sorted_);
  }
}

}  // namespace ktgp_orb::homography
