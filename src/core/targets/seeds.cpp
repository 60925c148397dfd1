#include "core/targets/seeds.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "core/growth/map_fit.h"

namespace ktgp_orb::targets {
namespace {

constexpr std::size_t kMost = 300;       // pairs; the first ones are used, to limit the time
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

/// What the votes depend on.
struct Map {
  float from_x, from_y, to_x, to_y, log_area;
  float xx, xy, yx, yy;  // linear
  float norm;            // of linear
};

Map mapOf(const Seed& seed) {
  const Eigen::Matrix2f& m = seed.linear;
  return {seed.from.x(), seed.from.y(), seed.to.x(), seed.to.y(), seed.log_area,
          m(0, 0),       m(0, 1),       m(1, 0),     m(1, 1),     m.norm()};
}

/// Whether `voter` lies where the map of `seed` predicts, and has a similar map. Without branches,
/// so that a loop over the voters becomes vector code.
inline bool agrees(const Map& voter, const Map& seed) {
  const float x = voter.from_x - seed.from_x;
  const float y = voter.from_y - seed.from_y;
  const float squared = x * x + y * y;
  const float there_x = seed.xx * x + seed.xy * y;
  const float there_y = seed.yx * x + seed.yy * y;
  const float to_x = voter.to_x - seed.to_x;
  const float to_y = voter.to_y - seed.to_y;
  const float error_x = to_x - there_x;
  const float error_y = to_y - there_y;
  const float product =
      voter.xx * seed.xx + voter.xy * seed.xy + voter.yx * seed.yx + voter.yy * seed.yy;
  const float slack =
      kSlack * kSlack + kRelativeSlack * kRelativeSlack * (there_x * there_x + there_y * there_y);
  return static_cast<bool>(static_cast<int>(squared <= kReach * kReach) &
                           static_cast<int>(squared >= kApart * kApart) &
                           static_cast<int>(std::abs(voter.log_area - seed.log_area) <= kLogArea) &
                           static_cast<int>(error_x * error_x + error_y * error_y <= slack) &
                           static_cast<int>(to_x * to_x + to_y * to_y >= 0.25F * kApart * kApart) &
                           static_cast<int>(product > kCosine * voter.norm * seed.norm));
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
  columns_.resize(kColumns * seeds_.size());
  const std::size_t n = seeds_.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Map map = mapOf(seeds_[i]);
    const float values[kColumns] = {map.from_x, map.from_y, map.to_x, map.to_y, map.log_area,
                                    map.xx,     map.xy,     map.yx,   map.yy,   map.norm};
    for (std::size_t c = 0; c < kColumns; ++c) columns_[c * n + i] = values[c];
  }
  const float* column = columns_.data();
  for (Seed& seed : seeds_) {
    const Map map = mapOf(seed);
    std::int32_t votes = 0;
    for (std::size_t j = 0; j < n; ++j) {
      const Map voter{column[j],         column[n + j],     column[2 * n + j], column[3 * n + j],
                      column[4 * n + j], column[5 * n + j], column[6 * n + j], column[7 * n + j],
                      column[8 * n + j], column[9 * n + j]};
      votes += static_cast<std::int32_t>(agrees(voter, map));
    }
    seed.votes = votes;
  }
  const auto is_alone = [&](const Seed& seed) { return seed.votes < fewest_votes; };
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
    if (agrees(mapOf(voter), mapOf(seed))) near.push_back(place(voter));
  }
  return growth::fitAffineNear(near, place(seed), seed.linear.cast<double>(), kOwnReach);
}

}  // namespace ktgp_orb::targets
