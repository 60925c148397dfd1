#include "core/homography/verdict.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstring>

#include "core/homography/estimator.h"
#include "core/util/constants.h"

namespace ktgp_orb {
namespace {

double boundingBoxArea(const std::vector<Eigen::Vector2d>& points) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : points) box.extend(p);
  return box.volume();
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

double chanceInlier(const PointPairs& pairs, double distance) {
  constexpr double kLeast = 0.01;
  constexpr double kMost = 0.5;
  const double disc = kPi * distance * distance;
  return std::clamp(disc / std::max(boundingBoxArea(pairs.target), disc), kLeast, kMost);
}

bool HomographyVerdict::explainableByChance(const PointPairs& pairs,
                                            const std::vector<std::uint8_t>& mask,
                                            const std::vector<double>& squared_error,
                                            double threshold) {
  inliers_.clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (mask[i] != 0) inliers_.push_back(i);
  }
  const double area = boundingBoxArea(pairs.target);
  const double distance2 = threshold * threshold;
  const auto chance = [&](double squared) { return kPi * std::max(squared, 1.0 / kPi) / area; };
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
