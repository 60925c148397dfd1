#include "core/targets/seeds.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "core/growth/map_fit.h"

namespace ktgp_orb::targets {
namespace {

constexpr std::int32_t kFewestVotes = 2;
constexpr std::size_t kMost = 200;       // bounds the time; the most similar ones
constexpr float kReach = 150.F;          // px of the picture
constexpr float kApart = 8.F;            // px; nearer keypoints may show the same corner
constexpr float kCosine = 0.85F;         // between the maps
constexpr float kLogArea = 0.94F;        // a factor of 1.6 in length
constexpr float kSlack = 4.F;            // px of the frame
constexpr float kRelativeSlack = 0.25F;  // of the distance there

Seed seedOf(const IndexHit& hit, const growth::ReferenceFrames& reference,
            const growth::LocalFrame& to) {
  const growth::LocalFrame& from = reference.frames()[hit.keypoint];
  const Eigen::Matrix2f to_view = reference.fromView(hit.keypoint).inverse().cast<float>();
  const float area = std::abs(to_view.determinant());
  // In the view, the pair is a similarity: its direction and size there.
  const Eigen::Vector2f d = (to_view * Eigen::Vector2f(from.dx, from.dy)).normalized();
  const float scale = std::exp(to.log_size - from.log_size) / std::sqrt(area);
  const float c = scale * (d.x() * to.dx + d.y() * to.dy);
  const float s = scale * (d.x() * to.dy - d.y() * to.dx);
  Seed seed;
  seed.from = {from.x, from.y};
  seed.to = {to.x, to.y};
  seed.linear = (Eigen::Matrix2f() << c, -s, s, c).finished() * to_view;
  seed.log_area = 2.F * (to.log_size - from.log_size);
  seed.votes = 0;
  seed.query = hit.query;
  return seed;
}

bool votesFor(const Seed& voter, const Seed& seed) {
  const Eigen::Vector2f step = voter.from - seed.from;
  const float squared = step.squaredNorm();
  if (squared > kReach * kReach || squared < kApart * kApart) return false;
  if (std::abs(voter.log_area - seed.log_area) > kLogArea) return false;
  const Eigen::Vector2f there = seed.linear * step;
  const float slack = kSlack + kRelativeSlack * there.norm();
  const Eigen::Vector2f to = voter.to - seed.to;
  if ((to - there).squaredNorm() > slack * slack || to.squaredNorm() < 0.25F * kApart * kApart) {
    return false;
  }
  const float product = voter.linear.cwiseProduct(seed.linear).sum();
  return product > kCosine * voter.linear.norm() * seed.linear.norm();
}

}  // namespace

void Seeds::collect(const IndexHit* begin, const IndexHit* end,
                    const growth::ReferenceFrames& reference,
                    const std::vector<growth::LocalFrame>& frames,
                    const std::vector<std::uint8_t>& taken) {
  seeds_.clear();
  for (const IndexHit* hit = begin; hit != end && seeds_.size() < kMost; ++hit) {
    if (!taken.empty() && taken[hit->query] != 0) continue;
    seeds_.push_back(seedOf(*hit, reference, frames[hit->query]));
  }
  vote();
}

void Seeds::vote() {
  for (std::size_t i = 0; i < seeds_.size(); ++i) {
    for (std::size_t j = 0; j < seeds_.size(); ++j) {
      if (i != j && votesFor(seeds_[j], seeds_[i])) ++seeds_[i].votes;
    }
  }
  const auto is_alone = [](const Seed& seed) { return seed.votes < kFewestVotes; };
  seeds_.erase(std::remove_if(seeds_.begin(), seeds_.end(), is_alone), seeds_.end());
  std::stable_sort(seeds_.begin(), seeds_.end(),
                   [](const Seed& a, const Seed& b) { return a.votes > b.votes; });
}

Eigen::Matrix3d affineOf(const Seed& seed, const std::vector<Seed>& seeds) {
  constexpr double kOwnReach = 30.0;  // px; weight of the seed's own direction and size
  const auto place = [](const Seed& one) {
    return growth::PlacePair{one.from.cast<double>(), one.to.cast<double>()};
  };
  std::vector<growth::PlacePair> near;
  for (const Seed& voter : seeds) {
    if (votesFor(voter, seed)) near.push_back(place(voter));
  }
  return growth::fitAffineNear(near, place(seed), seed.linear.cast<double>(), kOwnReach);
}

}  // namespace ktgp_orb::targets
