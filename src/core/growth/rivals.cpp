#include "core/growth/rivals.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/homography/transform.h"

namespace ktgp_orb::growth {
namespace {

constexpr double kCell = 32.0;  // px

std::size_t cellsAlong(int length) {
  return static_cast<std::size_t>(std::max(length, 0) / kCell) + 1;
}

/// Cells with matches, beyond the four that any homography has.
double evidence(const Grown& grown) {
  return static_cast<double>(grown.judgement.matched) - 4.0;
}

}  // namespace

std::size_t Rivals::cellOf(const Eigen::Vector2d& target) const {
  const auto clamped = [](double v, std::size_t count) {
    return static_cast<std::size_t>(std::clamp(v / kCell, 0.0, static_cast<double>(count - 1)));
  };
  return clamped(target.y(), rows_) * columns_ + clamped(target.x(), columns_);
}

bool Rivals::contradicts(const Grown& rival, const Grown& grown, const cv::Size& target) {
  constexpr double kDeviations = 2.0;  // of the difference of two counts
  constexpr double kElsewhere = 10.0;  // px of the target
  constexpr std::size_t kShare = 4;    // one in so many
  const double difference = evidence(grown) - evidence(rival);
  const double both = std::max(evidence(grown) + evidence(rival), 0.0);
  if (difference > kDeviations * std::sqrt(both)) return false;
  columns_ = cellsAlong(target.width);
  rows_ = cellsAlong(target.height);
  covered_.assign(columns_ * rows_, 0);
  for (const PlacePair& pair : grown.pairs) covered_[cellOf(pair.target)] = 1;
  const auto is_contrary = [&](const PlacePair& pair) {
    return covered_[cellOf(pair.target)] != 0 &&
           !(reprojectionError(grown.map, pair.reference, pair.target) < kElsewhere);
  };
  const auto contrary = std::count_if(rival.pairs.begin(), rival.pairs.end(), is_contrary);
  return kShare * static_cast<std::size_t>(contrary) > rival.pairs.size();
}

}  // namespace ktgp_orb::growth
