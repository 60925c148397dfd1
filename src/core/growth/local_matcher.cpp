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
  const std::size_t pitch = target.size() + kReadBeyond;
  columns_.assign(5 * pitch, 0.F);
  for (std::size_t i = 0; i < target.size(); ++i) {
    const LocalFrame& frame = frames_[i];
    const float values[] = {frame.x, frame.y, frame.dx, frame.dy, frame.log_size};
    for (std::size_t c = 0; c < 5; ++c) columns_[c * pitch + i] = values[c];
  }
  alike_.resize(target.size());
}

KeypointColumns LocalMatcher::columns() const {
  const std::size_t pitch = frames_.size() + kReadBeyond;
  const float* x = columns_.data();
  return {x, x + pitch, x + 2 * pitch, x + 3 * pitch, x + 4 * pitch};
}

std::size_t LocalMatcher::match(const std::vector<Prediction>& predictions,
                                const std::vector<Bits>& reference, const cv::Point2f& shift,
                                float radius, std::vector<LocalMatch>& matches) {
  matches.clear();
  best_reference_.assign(frames_.size(), kNoKey);
  const float squared_radius = radius * radius;
  const KeypointColumns keypoints = columns();
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
    const AlikeQuery query{x, y, wanted.dx, wanted.dy, wanted.log_size, squared_radius};
    std::size_t count = 0;
    cells_.visitRuns(x, y, radius, [&](std::uint32_t begin, std::uint32_t end) {
      count += kernel_->find(keypoints, begin, end, query, alike_.data() + count, is_near);
    });
    for (std::size_t k = 0; k < count; ++k) {
      const std::uint32_t i = alike_[k];
      const int d = distance(bits, bits_[i]);
      if (d > kMaxDistance) continue;
      ++candidates_;
      const std::int64_t here = key(d, cells_.order()[i]);
      if (here < best) {
        best = here;
        best_place = i;
      }
      best_reference_[i] = std::min(best_reference_[i], key(d, index));
    }
    near += is_near ? 1 : 0;
    if (best == kNoKey) continue;
    const float error_x = frames_[best_place].x - x;
    const float error_y = frames_[best_place].y - y;
    matches.push_back({index, static_cast<std::int32_t>(best_place),
                       static_cast<std::int32_t>(best >> 32),
                       error_x * error_x + error_y * error_y});
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
