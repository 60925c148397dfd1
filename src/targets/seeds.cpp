#include "targets/seeds.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "core/growth/map_fit.h"

namespace ktgp_orb::targets {
namespace {

constexpr std::size_t kMost = 300;  // pairs; the first ones are used, to limit the time

Seed seedOf(const IndexHit& hit, const growth::ReferenceFrames& reference,
            const growth::LocalFrame& to) {
  const growth::LocalFrame& from = reference.frames()[hit.keypoint];
  const Eigen::Matrix2f& to_view = reference.toView(hit.keypoint);
  const float area = std::abs(to_view.determinant());
  // From the view to the frame the map is a similarity, which the directions and sizes of the two
  // keypoints give.
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

SeedMap mapOf(const Seed& seed) {
  const Eigen::Matrix2f& m = seed.linear;
  return {seed.from.x(), seed.from.y(), seed.to.x(), seed.to.y(), seed.log_area,
          m(0, 0),       m(0, 1),       m(1, 0),     m(1, 1),     m.norm()};
}

}  // namespace

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
  maps_.clear();
  for (std::size_t i = 0; i < seeds_.size(); ++i) {
    const SeedMap map = mapOf(seeds_[i]);
    const float values[kSeedMapValues] = {map.from_x, map.from_y, map.to_x, map.to_y, map.log_area,
                                          map.xx,     map.xy,     map.yx,   map.yy,   map.norm};
    for (std::size_t c = 0; c < kSeedMapValues; ++c) columns_[c * pitch + i] = values[c];
    maps_.push_back(map);
  }
  for (std::size_t i = 0; i < seeds_.size(); ++i) {
    seeds_[i].votes = kernel_->votes(columns_.data(), pitch, seeds_.size(), maps_[i]);
  }
  const auto is_alone = [&](const Seed& seed) { return seed.votes < fewest_votes; };
  seeds_.erase(std::remove_if(seeds_.begin(), seeds_.end(), is_alone), seeds_.end());
  std::stable_sort(seeds_.begin(), seeds_.end(),
                   [](const Seed& a, const Seed& b) { return a.votes > b.votes; });
}

Eigen::Matrix3d affineOf(const Seed& seed, const std::vector<Seed>& seeds) {
  constexpr double kOwnReach = 30.0;  // px; weight of the seed's own direction and size
  growth::Places from, to;
  for (const Seed& voter : seeds) {
    if (!agrees(mapOf(voter), mapOf(seed))) continue;
    from.push_back(voter.from.cast<double>());
    to.push_back(voter.to.cast<double>());
  }
  return growth::fitAffineNear(from, to, seed.from.cast<double>(), seed.to.cast<double>(),
                               seed.linear.cast<double>(), kOwnReach);
}

}  // namespace ktgp_orb::targets
