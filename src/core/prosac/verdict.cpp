#include "core/prosac/verdict.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>

namespace ktgp_orb {
namespace {

constexpr double kLogMaxFalseAlarms = -4.0;  // log10
constexpr double kPi = 3.14159265358979323846;

double boundingBoxArea(const std::vector<Eigen::Vector2d>& points) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : points) box.extend(p);
  return box.volume();
}

/// log10 of (N - 4) C(N, k) C(k, 4) p^(k-4), for k = 4, 5, …
class FalseAlarms {
 public:
  explicit FalseAlarms(std::size_t pairs) : n_(static_cast<double>(pairs)) {
    for (int i = 1; i <= 4; ++i) log_subsets_ += std::log10((n_ - 4.0 + i) / i);
    log_subsets_ += std::log10(std::max(n_ - 4.0, 1.0));
  }

  /// Goes from k to k + 1: C(N, k) C(k, 4) becomes (N - k) / (k - 3) times as much.
  double next(double p) {
    log_subsets_ += std::log10((n_ - k_) / (k_ - 3.0));
    k_ += 1.0;
    return log_subsets_ + (k_ - 4.0) * std::log10(std::min(p, 1.0));
  }

 private:
  double n_;
  double k_ = 4.0;
  double log_subsets_ = 0.0;
};

std::uint64_t hash(const Eigen::Vector2d& p) {
  std::uint64_t bits[2];
  const Eigen::Vector2d q = p + Eigen::Vector2d::Zero();  // -0 becomes 0
  std::memcpy(bits, q.data(), sizeof bits);
  std::uint64_t h = (bits[0] ^ (bits[1] << 32 | bits[1] >> 32)) * 0x9e3779b97f4a7c15U;
  h = (h ^ (h >> 29)) * 0xbf58476d1ce4e5b9U;
  return h ^ (h >> 32);
}

}  // namespace

bool ProsacVerdict::explainableByChance(const PointPairs& pairs,
                                        const std::vector<std::uint8_t>& mask,
                                        const std::vector<double>& squared_error,
                                        double threshold) {
  inliers_.clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (mask[i] != 0) inliers_.push_back(i);
  }
  // Any order gives a valid bound, the largest error so far being that of the last one taken. Good
  // models pass as they come, after a few inliers; only poor ones are worth sorting.
  if (!explainable(pairs, squared_error, threshold)) return false;
  std::sort(inliers_.begin(), inliers_.end(), [&](std::size_t a, std::size_t b) {
    return squared_error[a] != squared_error[b] ? squared_error[a] < squared_error[b] : a < b;
  });
  return explainable(pairs, squared_error, threshold);
}

/// The rule on the inliers in the order that they are in.
bool ProsacVerdict::explainable(const PointPairs& pairs, const std::vector<double>& squared_error,
                                double threshold) {
  const double area = boundingBoxArea(pairs.target);
  FalseAlarms false_alarms(pairs.size());
  double largest = 1.0 / kPi;
  taken_.clear();
  for (const std::size_t candidate : inliers_) {
    if (!isApart(pairs, candidate, threshold)) continue;
    taken_.push_back(candidate);
    largest = std::max(largest, squared_error[candidate]);
    if (taken_.size() <= 4) continue;
    if (false_alarms.next(kPi * largest / area) < kLogMaxFalseAlarms) return false;
  }
  return true;
}

bool ProsacVerdict::isApart(const PointPairs& pairs, std::size_t candidate, double distance) const {
  const double distance2 = distance * distance;
  return std::all_of(taken_.begin(), taken_.end(), [&](std::size_t other) {
    return (pairs.reference[other] - pairs.reference[candidate]).squaredNorm() > distance2 &&
           (pairs.target[other] - pairs.target[candidate]).squaredNorm() > distance2;
  });
}

std::size_t ProsacVerdict::distinctInliers(const PointPairs& pairs,
                                           const std::vector<std::uint8_t>& mask) {
  return std::min(distinct(pairs.reference, mask), distinct(pairs.target, mask));
}

std::size_t ProsacVerdict::distinct(const std::vector<Eigen::Vector2d>& points,
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
