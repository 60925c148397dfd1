#include "estimation/false_alarms.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "util/constants.h"
#include "util/divide.h"

namespace ktgp_orb::estimation {
namespace {

/// Sets the bounds of the coordinate `axis` beyond which a point is a far outlier. The bounds are
/// computed from the quartiles of at most 32 points, taken evenly from `points`. If the two
/// quartiles are equal, the bounds do not change.
void setFences(const std::vector<Eigen::Vector2d>& points, Eigen::Index axis,
               Eigen::AlignedBox2d& fences) {
  constexpr std::size_t kEnough = 32;
  constexpr double kFarOut = 3.0;  // distance of a bound from its quartile, in interquartile ranges
  std::array<double, kEnough> sample{};
  const std::size_t stride = util::ceilDivide(points.size(), kEnough);
  std::size_t count = 0;
  for (std::size_t i = 0; i < points.size(); i += stride) sample[count++] = points[i][axis];
  if (count == 0) return;
  const auto end = sample.begin() + static_cast<std::ptrdiff_t>(count);
  const auto quartile = [&](std::size_t place) {
    const auto at = sample.begin() + static_cast<std::ptrdiff_t>(place);
    std::nth_element(sample.begin(), at, end);
    return *at;
  };
  const double lower = quartile(count / 4);
  const double upper = quartile(count - 1 - count / 4);
  if (!(upper > lower)) return;
  const double reach = kFarOut * (upper - lower);
  fences.min()[axis] = lower - reach;
  fences.max()[axis] = upper + reach;
}

}  // namespace

FalseAlarms::FalseAlarms(std::size_t sample_size, std::size_t pairs)
    : m_(static_cast<double>(sample_size)), n_(static_cast<double>(pairs)), k_(m_) {
  for (std::size_t i = 1; i <= sample_size; ++i) {
    const double x = static_cast<double>(i);
    log_subsets_ += std::log10((n_ - m_ + x) / x);
  }
  log_subsets_ += std::log10(std::max(n_ - m_, 1.0));
}

double FalseAlarms::next(double p) {
  // If k grows by 1, C(N, k) C(k, m) grows by the factor (N - k) / (k + 1 - m).
  log_subsets_ += std::log10((n_ - k_) / (k_ + 1.0 - m_));
  k_ += 1.0;
  return log_subsets_ + (k_ - m_) * std::log10(std::min(p, 1.0));
}

double coveredArea(const std::vector<Eigen::Vector2d>& points) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Eigen::AlignedBox2d fences(Eigen::Vector2d::Constant(-kInfinity),
                             Eigen::Vector2d::Constant(kInfinity));
  setFences(points, 0, fences);
  setFences(points, 1, fences);
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : points) {
    if (fences.contains(p)) box.extend(p);
  }
  return box.isEmpty() ? 0.0 : box.volume();
}

double chanceInlier(double covered_area, double distance) {
  constexpr double kLeast = 0.01;
  constexpr double kMost = 0.5;
  const double disc = util::kPi * distance * distance;
  return std::clamp(disc / std::max(covered_area, disc), kLeast, kMost);
}

}  // namespace ktgp_orb::estimation
