#include "growth/local_matcher.h"

#include <algorithm>
#include <limits>

namespace ktgp_orb::growth {
namespace {

/// The inner loop of match() in plain C++. The vector kernels must give the same results.
std::size_t findAlike(const float* columns, std::size_t pitch, std::uint32_t begin,
                      std::uint32_t end, const LocalFrame& predicted, float squared_radius,
                      std::uint32_t* alike, bool& is_near) {
  std::size_t count = 0;
  for (std::uint32_t i = begin; i < end; ++i) {
    const auto value = [&](std::size_t column) { return columns[column * pitch + i]; };
    const float x = value(0) - predicted.x;
    const float y = value(1) - predicted.y;
    if (!(x * x + y * y <= squared_radius)) continue;
    is_near = true;
    const float cosine = value(2) * predicted.dx + value(3) * predicted.dy;
    const float log_scale = std::abs(value(4) - predicted.log_size);
    if (cosine >= kAlikeCosine && log_scale <= kAlikeLogScale) alike[count++] = i;
  }
  return count;
}

constexpr std::int64_t kNoKey = std::numeric_limits<std::int64_t>::max();

/// Packs a Hamming distance and a keypoint number into one key. The smaller key belongs to the
/// smaller distance or, at equal distances, to the lower number.
std::int64_t key(int distance, std::int32_t number) {
  return (static_cast<std::int64_t>(distance) << 32) | number;
}

}  // namespace

const AlikeKernel& portableAlikeKernel() {
  static constexpr AlikeKernel kPortable{"portable", findAlike};
  return kPortable;
}

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
  pitch_ = target.size() + kReadBeyond;
  columns_.assign(kLocalFrameValues * pitch_, 0.F);
  for (std::size_t i = 0; i < target.size(); ++i) {
    const LocalFrame& frame = frames_[i];
    const float values[kLocalFrameValues] = {frame.x, frame.y, frame.dx, frame.dy, frame.log_size};
    for (std::size_t c = 0; c < kLocalFrameValues; ++c) columns_[c * pitch_ + i] = values[c];
  }
  alike_.resize(target.size());
}

/// Finds the keypoint with the most similar descriptor among the first `count` entries of alike_.
/// Returns its key and sets `place` to its index in frames_; returns kNoKey if all distances exceed
/// kMaxDistance. `index`, `bits`: number and descriptor of the reference keypoint.
std::int64_t LocalMatcher::nearest(std::int32_t index, const Bits& bits, std::size_t count,
                                   std::uint32_t& place) {
  std::int64_t best = kNoKey;
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint32_t i = alike_[k];
    const int d = distance(bits, bits_[i]);
    if (d > kMaxDistance) continue;
    ++candidates_;
    const std::int64_t here = key(d, cells_.order()[i]);
    if (here < best) {
      best = here;
      place = i;
    }
    best_reference_[i] = std::min(best_reference_[i], key(d, index));
  }
  return best;
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
    LocalFrame wanted = prediction.frame;
    wanted.x += shift.x;
    wanted.y += shift.y;
    const std::int32_t index = prediction.reference;
    const Bits& bits = reference[static_cast<std::size_t>(index)];
    bool is_near = false;
    std::size_t count = 0;
    cells_.visitRuns(wanted.x, wanted.y, radius, [&](std::uint32_t begin, std::uint32_t end) {
      count += kernel_->find(columns_.data(), pitch_, begin, end, wanted, squared_radius,
                             alike_.data() + count, is_near);
    });
    near += is_near ? 1 : 0;
    std::uint32_t best_place = 0;
    const std::int64_t best = nearest(index, bits, count, best_place);
    if (best == kNoKey) continue;
    const float error_x = frames_[best_place].x - wanted.x;
    const float error_y = frames_[best_place].y - wanted.y;
    matches.push_back({index, cells_.order()[best_place], static_cast<std::int32_t>(best >> 32),
                       error_x * error_x + error_y * error_y});
  }
  const auto is_one_way = [&](const LocalMatch& m) {
    const std::uint32_t place = position_[static_cast<std::size_t>(m.target)];
    return static_cast<std::int32_t>(best_reference_[place] & 0xffffffff) != m.reference;
  };
  matches.erase(std::remove_if(matches.begin(), matches.end(), is_one_way), matches.end());
  return near;
}

}  // namespace ktgp_orb::growth
