#include "core/homography/verdict.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#include "core/homography/estimator.h"
#include "core/util/constants.h"
#include "core/util/divide.h"

namespace ktgp_orb {
namespace {

using util::ceilDivide;
using util::kPi;

/// Bounds beyond which one coordinate of a point is far out.
struct Fences {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
};

/// Quartiles of a few points, spread over the input, tell far from near. None where they are equal.
Fences fencesOf(const std::vector<Eigen::Vector2d>& points, Eigen::Index axis) {
  constexpr std::size_t kEnough = 32;
  constexpr double kFarOut = 3.0;  // interquartile ranges
  std::array<double, kEnough> sample{};
  const std::size_t stride = ceilDivide(points.size(), kEnough);
  std::size_t count = 0;
  for (std::size_t i = 0; i < points.size(); i += stride) sample[count++] = points[i][axis];
  if (count == 0) return {};
  const auto end = sample.begin() + static_cast<std::ptrdiff_t>(count);
  const auto quartile = [&](std::size_t place) {
    const auto at = sample.begin() + static_cast<std::ptrdiff_t>(place);
    std::nth_element(sample.begin(), at, end);
    return *at;
  };
  const double lower = quartile(count / 4);
  const double upper = quartile(count - 1 - count / 4);
  if (!(upper > lower)) return {};
  const double reach = kFarOut * (upper - lower);
  return {lower - reach, upper + reach};
}

std::uint64_t hash(const Eigen::Vector2d& p) {
  std::uint64_t bits[2];
  const Eigen::Vector2d q = p + Eigen::Vector2d::Zero();  // -0 becomes 0
  std::memcpy(bits, q.data(), sizeof bits);
  std::uint64_t h = (bits[0] ^ (bits[1] << 32 | bits[1] >> 32)) * 0x9e3779b97f4a7c15U;
  h = (h ^ (h >> 29)) * 0xbf58476d1ce4e5b9U;
  return h ^ (h >> 32);
}

}  // namespace

double coveredArea(const std::vector<Eigen::Vector2d>& points) {
  const Fences x = fencesOf(points, 0);
  const Fences y = fencesOf(points, 1);
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : points) {
    if (p.x() < x.low || p.x() > x.high || p.y() < y.low || p.y() > y.high) continue;
    box.extend(p);
  }
  return box.isEmpty() ? 0.0 : box.volume();
}

double chanceInlier(double covered_area, double distance) {
  constexpr double kLeast = 0.01;
  constexpr double kMost = 0.5;
  const double disc = kPi * distance * distance;
  return std::clamp(disc / std::max(covered_area, disc), kLeast, kMost);
}

bool HomographyVerdict::explainableByChance(const PointPairs& pairs,
                                            const std::vector<std::uint8_t>& mask,
                                            const std::vector<double>& squared_error,
                                            double threshold, double covered_area) {
  inliers_.clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (mask[i] != 0) inliers_.push_back(i);
  }
  const double distance2 = threshold * threshold;
  const auto chance = [&](double squared) {
    return kPi * std::max(squared, 1.0 / kPi) / covered_area;
  };
  const auto apart = [&](std::size_t a, std::size_t b) {
    return (pairs.reference[a] - pairs.reference[b]).squaredNorm() > distance2 &&
           (pairs.target[a] - pairs.target[b]).squaredNorm() > distance2;
  };
  return verdict_.explainableByChance(HomographyEstimator::kSampleSize, pairs.size(), squared_error,
                                      inliers_, chance, apart);
}

std::size_t HomographyVerdict::distinctInliers(const PointPairs& pairs,
                                               const std::vector<std::uint8_t>& mask) {
  return std::min(distinct(pairs.reference, mask), distinct(pairs.target, mask));
}

std::size_t HomographyVerdict::distinct(const std::vector<Eigen::Vector2d>& points,
                                        const std::vector<std::uint8_t>& mask) {
  std::size_t slots = 16;
  while (slots < 2 * points.size()) slots *= 2;
  const auto empty = static_cast<std::uint32_t>(points.size());
  table_.assign(slots, empty);
  std::size_t count = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (mask[i] == 0) continue;
    std::size_t slot = hash(points[i]) & (slots - 1);
    while (table_[slot] != empty && points[table_[slot]] != points[i]) {
      slot = (slot + 1) & (slots - 1);
    }
    if (table_[slot] != empty) continue;
    table_[slot] = static_cast<std::uint32_t>(i);
    ++count;
  }
  return count;
}

}  // namespace ktgp_orb
