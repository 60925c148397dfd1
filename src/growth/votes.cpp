#include "growth/votes.h"

#include <algorithm>
#include <cmath>

#include "util/cells.h"

namespace ktgp_orb::growth {
namespace {

// Cosine of 0.5 rad, the largest difference between two rotations.
constexpr float kCosine = 0.877583F;
constexpr float kLogScale = 0.470004F;  // logarithm of the largest ratio of scales, 1.6
// A voter may be off its predicted position by kSlack px of the target, plus kRelativeSlack times
// the predicted distance between the voter and the match in the target.
constexpr float kSlack = 4.F;
constexpr float kRelativeSlack = 0.45F;

constexpr double kCell = 8.0;  // px; side of the cells that vote once

}  // namespace

bool Votes::votesFor(const Similarity& voter, const Similarity& pair) const {
  const float x = voter.x - pair.x;
  const float y = voter.y - pair.y;
  const float squared = x * x + y * y;
  if (squared > reach_ * reach_) return false;
  if (std::abs(voter.log_scale - pair.log_scale) > kLogScale) return false;
  if (voter.cosine * pair.cosine + voter.sine * pair.sine < kCosine) return false;
  const float c = pair.scale * pair.cosine;
  const float s = pair.scale * pair.sine;
  const float u = pair.u + c * x - s * y - voter.u;
  const float v = pair.v + s * x + c * y - voter.v;
  const float slack = kSlack + kRelativeSlack * pair.scale * std::sqrt(squared);
  return u * u + v * v <= slack * slack;
}

void Votes::add(const LocalFrame& from, const LocalFrame& to) {
  const float log_scale = to.log_size - from.log_size;
  pairs_.push_back({from.x, from.y, to.x, to.y, from.dx * to.dx + from.dy * to.dy,
                    from.dx * to.dy - from.dy * to.dx, std::exp(log_scale), log_scale, 0, 0});
}

void Votes::count(const cv::Size& from_size, const cv::Size& to_size, std::int32_t enough,
                  float reach) {
  reach_ = reach;
  const util::Cells from(from_size, kCell), to(to_size, kCell);
  for (Similarity& pair : pairs_) {
    pair.from_cell = static_cast<std::uint32_t>(from.at(pair.x, pair.y));
    pair.to_cell = static_cast<std::uint32_t>(to.at(pair.u, pair.v));
  }
  cells_.build(
      pairs_.size(), [&](std::size_t i) { return cv::Point2f(pairs_[i].x, pairs_[i].y); },
      from_size, reach_);
  from_voted_.assign(from.count(), 0);
  to_voted_.assign(to.count(), 0);
  votes_.assign(pairs_.size(), 0);
  for (std::size_t i = 0; i < pairs_.size(); ++i) {
    const Similarity& pair = pairs_[i];
    const auto number = static_cast<std::uint32_t>(i + 1);
    from_voted_[pair.from_cell] = to_voted_[pair.to_cell] = number;
    std::int32_t votes = 0;
    cells_.visitRuns(pair.x, pair.y, reach_, [&](std::uint32_t begin, std::uint32_t end) {
      for (std::uint32_t k = begin; k < end && votes < enough; ++k) {
        const Similarity& voter = pairs_[static_cast<std::size_t>(cells_.order()[k])];
        if (from_voted_[voter.from_cell] == number || to_voted_[voter.to_cell] == number) continue;
        if (!votesFor(voter, pair)) continue;
        from_voted_[voter.from_cell] = to_voted_[voter.to_cell] = number;
        ++votes;
      }
    });
    votes_[i] = votes;
  }
}

void Votes::voters(std::int32_t number, std::vector<std::int32_t>& voters) const {
  voters.clear();
  const Similarity& wanted = pair(number);
  cells_.visitNear(wanted.x, wanted.y, reach_, [&](std::int32_t other) {
    if (other != number && votesFor(pair(other), wanted)) voters.push_back(other);
  });
}

}  // namespace ktgp_orb::growth
