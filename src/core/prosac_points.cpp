#include "prosac_points.h"

#include <algorithm>
#include <cstring>

namespace ktgp_orb {
namespace {

constexpr int kIndexBits = 32;
constexpr std::uint64_t kIndexMask = 0xffffffffU;

/// An integer that orders as the number does in single precision, which tells all ratios of Hamming
/// distances apart. One integer to compare makes sorting twice as fast as an indirect comparison.
std::uint64_t sortKey(double quality) {
  const float single = static_cast<float>(quality) + 0.0F;  // -0 becomes 0
  std::uint32_t bits = 0;
  std::memcpy(&bits, &single, sizeof bits);
  const bool negative = (bits >> 31) != 0;
  return bits ^ (negative ? 0xffffffffU : 0x80000000U);
}

}  // namespace

void ProsacPoints::load(const PointPairs& pairs, double threshold) {
  const std::size_t n = pairs.size();
  order_.resize(n);
  for (std::size_t i = 0; i < n; ++i) order_[i] = sortKey(pairs.quality[i]) << kIndexBits | i;
  std::sort(order_.begin(), order_.end());

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
