#include "core/growth/grower.h"

#include <cmath>
#include <cstddef>
#include <limits>

namespace ktgp_orb::growth {
namespace {

constexpr int kRounds = 10;
constexpr std::size_t kMaxLastRounds = 4;
constexpr double kFirstReach = 120.0;       // px of the reference
constexpr double kReachFactor = 4.0 / 3.0;  // a round
constexpr std::size_t kFewestForHomography = 12;

/// Matches that a round needs: a right seed has found more by then.
std::size_t fewest(int round) {
  return 4 + static_cast<std::size_t>(round) / 2;
}

}  // namespace

void Grower::search(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre, double reach,
                    float radius, ReferenceFrames& reference, LocalMatcher& matcher) {
  reference.predict(map, centre, reach, predictions_);
  matcher.match(predictions_, reference.bits(), {}, radius, matches_);
  pairs_.clear();
  for (const LocalMatch& m : matches_) {
    const LocalFrame& from = reference.frames()[static_cast<std::size_t>(m.reference)];
    const LocalFrame& to = matcher.frame(m.target);
    pairs_.push_back({Eigen::Vector2d(from.x, from.y), Eigen::Vector2d(to.x, to.y)});
  }
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
    search(map, centre, reach, radius, reference, matcher);
    if (pairs_.size() < fewest(round) || !refit(radius, map)) return false;
    reach *= kReachFactor;
    radius *= shrink;
  }
  constexpr double kEverywhere = std::numeric_limits<float>::max();
  for (std::size_t round = 0, before = 0;; ++round) {
    search(map, centre, kEverywhere, kLastRadius, reference, matcher);
    if (pairs_.size() < kFewestForHomography) return false;
    if (pairs_.size() <= before || round == kMaxLastRounds) return true;
    before = pairs_.size();
    if (!refit(kLastRadius, map)) return false;
  }
}

}  // namespace ktgp_orb::growth
