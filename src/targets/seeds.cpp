#include "targets/seeds.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "growth/map_fit.h"

namespace ktgp_orb::targets {
namespace {

/// The loop that counts the votes for a seed in plain C++, the reference for the vector versions.
std::int32_t votesFor(const float* columns, std::size_t pitch, std::size_t count,
                      const SeedMap& seed) {
  std::int32_t votes = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = [&](std::size_t column) { return columns[column * pitch + i]; };
    const SeedMap voter{value(0), value(1), value(2), value(3), value(4),
                        value(5), value(6), value(7), value(8), value(9)};
    votes += agrees(voter, seed) ? 1 : 0;
  }
  return votes;
}

// To save time, Seeds::collect() makes seeds from at most this many pairs, the first in the list.
constexpr std::size_t kMost = 300;

Seed seedOf(const IndexHit& hit, const growth::ReferenceFrames& reference,
            const growth::LocalFrame& to) {
  const growth::LocalFrame& from = reference.frames()[hit.keypoint];
  const Eigen::Matrix2f& to_view = reference.toView(hit.keypoint);
  const float area = std::abs(to_view.determinant());
  // We assume that the keypoint's view of the picture is mapped to the frame by a rotation and a
  // scale; the directions and sizes of the two keypoints determine both. d: direction in the view;
  // c, s: cosine and sine of the rotation, times the scale.
  const Eigen::Vector2f d = (to_view * Eigen::Vector2f(from.dx, from.dy)).normalized();
  const float scale = std::exp(to.log_size - from.log_size) / std::sqrt(area);
  const float c = scale * (d.x() * to.dx + d.y() * to.dy);
  const float s = scale * (d.x() * to.dy - d.y() * to.dx);
  const Eigen::Matrix2f linear = (Eigen::Matrix2f() << c, -s, s, c).finished() * to_view;
  const float log_area = 2.F * (to.log_size - from.log_size);
  return {{from.x, from.y, to.x, to.y, log_area, linear(0, 0), linear(0, 1), linear(1, 0),
           linear(1, 1), linear.norm()},
          0,
          hit.query};
}

}  // namespace

const VoteKernel& portableVoteKernel() {
  static constexpr VoteKernel kPortable{"portable", votesFor};
  return kPortable;
}

void Seeds::collect(const IndexHit* begin, const IndexHit* end,
                    const growth::ReferenceFrames& reference,
                    const std::vector<growth::LocalFrame>& frames,
                    const std::vector<std::uint8_t>& taken, std::int32_t fewest_votes) {
  seeds_.clear();
  for (const IndexHit* hit = begin; hit != end && seeds_.size() < kMost; ++hit) {
    if (!taken.empty() && taken[hit->query] != 0) continue;
    seeds_.push_back(seedOf(*hit, reference, frames[hit->query]));
  }
  vote(fewest_votes);
}

void Seeds::vote(std::int32_t fewest_votes) {
  const std::size_t pitch = seeds_.size() + kReadBeyond;
  columns_.assign(kSeedMapValues * pitch, 0.F);
  for (std::size_t i = 0; i < seeds_.size(); ++i) {
    const SeedMap& map = seeds_[i].map;
    const float values[kSeedMapValues] = {map.from_x, map.from_y, map.to_x, map.to_y, map.log_area,
                                          map.xx,     map.xy,     map.yx,   map.yy,   map.norm};
    for (std::size_t c = 0; c < kSeedMapValues; ++c) columns_[c * pitch + i] = values[c];
  }
  for (Seed& seed : seeds_) {
    seed.votes = kernel_->votes(columns_.data(), pitch, seeds_.size(), seed.map);
  }
  const auto is_alone = [&](const Seed& seed) { return seed.votes < fewest_votes; };
  seeds_.erase(std::remove_if(seeds_.begin(), seeds_.end(), is_alone), seeds_.end());
  std::stable_sort(seeds_.begin(), seeds_.end(),
                   [](const Seed& a, const Seed& b) { return a.votes > b.votes; });
}

Eigen::Matrix3d affineOf(const Seed& seed, const std::vector<Seed>& seeds) {
  // The linear part of the seed's own map counts as much as two voters at this distance from the
  // seed, px of the picture (see fitAffineNear).
  constexpr double kOwnReach = 30.0;
  growth::Places from, to;
  for (const Seed& voter : seeds) {
    if (!agrees(voter.map, seed.map)) continue;
    from.push_back(voter.from());
    to.push_back(voter.to());
  }
  const SeedMap& own = seed.map;
  const Eigen::Matrix2d linear = (Eigen::Matrix2d() << own.xx, own.xy, own.yx, own.yy).finished();
  return growth::fitAffineNear(from, to, seed.from(), seed.to(), linear, kOwnReach);
}

}  // namespace ktgp_orb::targets
