#include "core/growth/local_matcher.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ktgp_orb::growth {
namespace {

constexpr std::int64_t kNoKey = std::numeric_limits<std::int64_t>::max();

/// The smaller key is nearer; for equal distances the lower number.
std::int64_t key(int distance, std::int32_t number) {
  return (static_cast<std::int64_t>(distance) << 32) | number;
}

}  // namespace

void LocalMatcher::setTarget(const Features& target) {
  image_size_ = target.image_size;
  cells_.build(
      target.size(), [&](std::size_t i) { return target.keypoints[i].pt; }, target.image_size,
      kCell);
  frames_.resize(target.size());
  bits_.resize(target.size());
  position_.resize(target.size());
  for (std::size_t i = 0; i < target.size(); ++i) {
    const auto index = static_cast<std::size_t>(cells_.order()[i]);
    frames_[i] = frameOf(target.keypoints[index]);
    bits_[i] = bitsOf(target, index);
    position_[index] = static_cast<std::uint32_t>(i);
  }
}

std::size_t LocalMatcher::match(const std::vector<Prediction>& predictions,
                                const std::vector<Bits>& reference, const cv::Point2f& shift,
                                float radius, std::vector<LocalMatch>& matches) {
  matches.clear();
  best_reference_.assign(frames_.size(), kNoKey);
  const float squared_radius = radius * radius;
  std::size_t near = 0;
  candidates_ = 0;
  for (const Prediction& prediction : predictions) {
    const LocalFrame& wanted = prediction.frame;
    const std::int32_t index = prediction.reference;
    const float x = wanted.x + shift.x;
    const float y = wanted.y + shift.y;
    const Bits& bits = reference[static_cast<std::size_t>(index)];
    bool is_near = false;
    std::int64_t best = kNoKey;
    std::uint32_t best_place = 0;
    float best_error = 0.F;
    cells_.visitRuns(x, y, radius, [&](std::uint32_t begin, std::uint32_t end) {
      for (std::uint32_t i = begin; i < end; ++i) {
        const LocalFrame& frame = frames_[i];
        const float ex = frame.x - x;
        const float ey = frame.y - y;
        const float squared = ex * ex + ey * ey;
        // One rarely taken branch is faster than four unpredictable ones.
        const bool is_inside = squared <= squared_radius;
        const bool turns_alike = frame.dx * wanted.dx + frame.dy * wanted.dy >= kCosine;
        const bool scales_alike = std::abs(frame.log_size - wanted.log_size) <= kLogScale;
        is_near |= is_inside;
        if (!(is_inside & turns_alike & scales_alike)) continue;
        const int d = distance(bits, bits_[i]);
        if (d > kMaxDistance) continue;
        ++candidates_;
        const std::int64_t here = key(d, cells_.order()[i]);
        if (here < best) {
          best = here;
          best_place = i;
          best_error = squared;
        }
        best_reference_[i] = std::min(best_reference_[i], key(d, index));
      }
    });
    near += is_near ? 1 : 0;
    if (best == kNoKey) continue;
    matches.push_back({index, static_cast<std::int32_t>(best_place),
                       static_cast<std::int32_t>(best >> 32), best_error});
  }
  const auto is_one_way = [&](const LocalMatch& m) {
    return static_cast<std::int32_t>(best_reference_[static_cast<std::size_t>(m.target)] &
                                     0xffffffff) != m.reference;
  };
  matches.erase(std::remove_if(matches.begin(), matches.end(), is_one_way), matches.end());
  for (LocalMatch& m : matches) m.target = cells_.order()[static_cast<std::size_t>(m.target)];
  return near;
}

}  // namespace ktgp_orb::growth
