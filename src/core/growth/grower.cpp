#include "core/growth/grower.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace ktgp_orb::growth {
namespace {

constexpr int kRounds = 10;
constexpr std::size_t kMaxLastRounds = 4;
constexpr double kFirstReach = 120.0;       // px of the reference
constexpr double kReachFactor = 4.0 / 3.0;  // per round
constexpr std::size_t kFewestForHomography = 12;

/// Matches within the last radius that a round needs. A right seed has found several times as many.
/// A wrong seed seldom has as many twice in a row; wrong seeds take nearly all of the time.
std::size_t fewest(int round) {
  return std::min<std::size_t>(4 + 2 * static_cast<std::size_t>(round), kFewestForHomography);
}

}  // namespace

bool Grower::search(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre, double reach,
                    float radius, ReferenceFrames& reference, LocalMatcher& matcher) {
  if (!reference.predict(map, centre, reach, matcher.imageSize(), predictions_)) return false;
  matcher.match(predictions_, reference.bits(), {}, radius, matches_);
  pairs_.clear();
  for (const LocalMatch& m : matches_) {
    const LocalFrame& from = reference.frames()[static_cast<std::size_t>(m.reference)];
    const LocalFrame& to = matcher.frame(m.target);
    pairs_.push_back({Eigen::Vector2d(from.x, from.y), Eigen::Vector2d(to.x, to.y)});
  }
  return true;
}

std::size_t Grower::exactPairs(const Eigen::Matrix3d& map) const {
  constexpr double kSquared = double{kLastRadius} * kLastRadius;
  const auto is_exact = [&](const PlacePair& pair) {
    const Eigen::Vector3d p = map * pair.reference.homogeneous();
    return (p.hnormalized() - pair.target).squaredNorm() < kSquared;
  };
  return static_cast<std::size_t>(std::count_if(pairs_.begin(), pairs_.end(), is_exact));
}

bool Grower::refit(float radius, Eigen::Matrix3d& map) const {
  const double scale = 0.5 * radius;
  if (pairs_.size() >= kFewestForHomography && fitHomography(pairs_, scale, map)) return true;
  return fitAffine(pairs_, scale, map);
}

bool Grower::grow(const Eigen::Vector2d& centre, ReferenceFrames& reference, LocalMatcher& matcher,
                  Eigen::Matrix3d& map) {
  double reach = kFirstReach;
  float radius = kFirstRadius;
  const float shrink = std::pow(kLastRadius / kFirstRadius, 1.F / (kRounds - 1));
  for (int round = 0; round < kRounds; ++round) {
    if (!search(map, centre, reach, radius, reference, matcher)) return false;
    if (exactPairs(map) < fewest(round) || !refit(radius, map)) return false;
    reach *= kReachFactor;
    radius *= shrink;
  }
  return settle(centre, reference, matcher, map);
}

bool Grower::settle(const Eigen::Vector2d& centre, ReferenceFrames& reference,
                    LocalMatcher& matcher, Eigen::Matrix3d& map) {
  constexpr double kEverywhere = std::numeric_limits<float>::max();
  for (std::size_t round = 0, before = 0;; ++round) {
    if (!search(map, centre, kEverywhere, kLastRadius, reference, matcher)) return false;
    if (pairs_.size() < kFewestForHomography) return false;
    if (pairs_.size() <= before || round == kMaxLastRounds) return true;
    before = pairs_.size();
    if (!refit(kLastRadius, map)) return false;
  }
}

}  // namespace ktgp_orb::growth
