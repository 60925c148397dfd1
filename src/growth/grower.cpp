#include "growth/grower.h"

#include <algorithm>
#include <cmath>

#include "growth/map_fit.h"

namespace ktgp_orb::growth {
namespace {

constexpr std::size_t kFewestForHomography = 12;

/// Distance of the farthest keypoint of the reference from the centre, px.
double farthest(const Eigen::Vector2d& centre, const ReferenceFrames& reference) {
  double squared = 0.0;
  for (const LocalFrame& frame : reference.frames()) {
    squared = std::max(squared, (Eigen::Vector2d(frame.x, frame.y) - centre).squaredNorm());
  }
  return std::sqrt(squared);
}

}  // namespace

bool refit(const PointPairs& pairs, float radius, Eigen::Matrix3d& map) {
  const double scale = 0.5 * radius;
  if (pairs.size() >= kFewestForHomography &&
      fitHomography(pairs.reference, pairs.target, scale, map)) {
    return true;
  }
  return fitAffine(pairs.reference, pairs.target, scale, map);
}

bool Grower::search(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre, double reach,
                    float radius, ReferenceFrames& reference, LocalMatcher& matcher) {
  matches_.clear();
  pairs_.clear();
  if (!reference.predict(map, centre, reach, matcher.imageSize(), predictions_)) return false;
  matcher.match(predictions_, reference.bits(), {}, radius, matches_);
  constexpr double kBits = 8.0 * kDescriptorBytes;
  for (const LocalMatch& m : matches_) {
    const LocalFrame& from = reference.frames()[static_cast<std::size_t>(m.reference)];
    const LocalFrame& to = matcher.frame(m.target);
    pairs_.add({from.x, from.y}, {to.x, to.y}, m.distance / kBits);
  }
  return pairs_.size() >= plan_.fewest_pairs;
}

std::size_t Grower::exactPairs() const {
  constexpr float kSquared = kLastRadius * kLastRadius;
  return static_cast<std::size_t>(
      std::count_if(matches_.begin(), matches_.end(),
                    [](const LocalMatch& match) { return match.squared_error < kSquared; }));
}

bool Grower::grow(const Eigen::Vector2d& centre, ReferenceFrames& reference, LocalMatcher& matcher,
                  Eigen::Matrix3d& map) {
  const double all = farthest(centre, reference);
  double reach = plan_.first_reach;
  float radius = plan_.first_radius;
  std::size_t exact = plan_.first_exact;
  for (int round = 0; round < plan_.rounds; ++round) {
    if (reach >= all && radius <= plan_.enough_radius) break;
    if (!search(map, centre, reach, radius, reference, matcher)) return false;
    if (exactPairs() < std::min(exact, plan_.most_exact) || !refit(pairs_, radius, map)) {
      return false;
    }
    exact += plan_.more_exact;
    reach *= plan_.reach_factor;
    radius = std::max(kLastRadius, radius * plan_.radius_factor);
  }
  return settle(centre, plan_.settle_radius, reference, matcher, map);
}

bool Grower::settle(const Eigen::Vector2d& centre, float radius, ReferenceFrames& reference,
                    LocalMatcher& matcher, Eigen::Matrix3d& map) {
  for (; radius > kLastRadius; radius *= 0.5F) {
    if (!search(map, centre, kEverywhere, radius, reference, matcher)) return false;
    if (!refit(pairs_, radius, map)) return false;
  }
  std::size_t before = 0;
  for (int round = 0;; ++round) {
    if (!search(map, centre, kEverywhere, kLastRadius, reference, matcher)) return false;
    if (pairs_.size() < plan_.most_exact) return false;
    if (pairs_.size() <= before || round == plan_.last_rounds) return true;
    before = pairs_.size();
    if (!refit(pairs_, kLastRadius, map)) return false;
  }
}

}  // namespace ktgp_orb::growth
