#include "growth/votes.h"

#include <algorithm>
#include <cmath>

namespace ktgp_orb::growth {
namespace {

// Cosine of 0.5 rad, the largest difference between two rotations.
constexpr float kCosine = 0.877583F;
constexpr float kLogScale = 0.470004F;  // logarithm of the largest ratio of scales, 1.6
// A voter may be off its predicted position by kSlack px of the target, plus kRelativeSlack times
// the predicted distance between the voter and the match in the target.
constexpr float kSlack = 4.F;
constexpr float kRelativeSlack = 0.45F;

constexpr float kCell = 8.F;  // px

std::size_t cellsAlong(int length) {
  return static_cast<std::size_t>(static_cast<float>(std::max(length, 0)) / kCell) + 1;
}

/// The cell that contains a position in an image of this `size`; the nearest cell if the position
/// is outside.
std::uint32_t cellOf(float x, float y, const cv::Size& size) {
  const auto clamped = [](float v, std::size_t count) {
    // The comparison is written so that NaN gets cell 0.
    return v >= kCell ? std::min(static_cast<std::size_t>(std::min(v / kCell, 1e6F)), count - 1)
                      : std::size_t{0};
  };
  const std::size_t columns = cellsAlong(size.width);
  const std::size_t cell = clamped(y, cellsAlong(size.height)) * columns + clamped(x, columns);
  return static_cast<std::uint32_t>(cell);
}

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
  for (Similarity& pair : pairs_) {
    pair.from_cell = cellOf(pair.x, pair.y, from_size);
    pair.to_cell = cellOf(pair.u, pair.v, to_size);
  }
  cells_.build(
      pairs_.size(), [&](std::size_t i) { return cv::Point2f(pairs_[i].x, pairs_[i].y); },
      from_size, reach_);
  from_voted_.assign(cellsAlong(from_size.width) * cellsAlong(from_size.height), 0);
  to_voted_.assign(cellsAlong(to_size.width) * cellsAlong(to_size.height), 0);
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
