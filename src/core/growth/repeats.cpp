#include "core/growth/repeats.h"

#include <algorithm>
#include <numeric>

namespace ktgp_orb::growth {
namespace {

constexpr float kReach = 120.F;   // px
constexpr float kBin = 6.F;       // px
constexpr float kOwn = 10.F;      // px; smaller shifts match the homography's own pairs
constexpr int kMaxDistance = 64;  // Hamming
constexpr int kSide = static_cast<int>(2 * kReach / kBin);

}  // namespace

const std::vector<cv::Point2f>& Repeats::find(const std::vector<Prediction>& predictions,
                                              const std::vector<Bits>& reference,
                                              const LocalMatcher& matcher) {
  bins_.assign(static_cast<std::size_t>(kSide) * kSide, {0, 0.F, 0.F});
  for (const Prediction& prediction : predictions) {
    const Bits& bits = reference[static_cast<std::size_t>(prediction.reference)];
    matcher.visitAlike(prediction.frame, kReach, [&](float dx, float dy, const Bits& other) {
      if (distance(bits, other) > kMaxDistance) return;
      const int column = std::clamp(static_cast<int>((dx + kReach) / kBin), 0, kSide - 1);
      const int row = std::clamp(static_cast<int>((dy + kReach) / kBin), 0, kSide - 1);
      const std::size_t place =
          static_cast<std::size_t>(row) * kSide + static_cast<std::size_t>(column);
      Bin& bin = bins_[place];
      ++bin.votes;
      bin.x += dx;
      bin.y += dy;
    });
  }
  order_.resize(bins_.size());
  std::iota(order_.begin(), order_.end(), 0);
  const auto votes = [&](std::int32_t bin) { return bins_[static_cast<std::size_t>(bin)].votes; };
  std::partial_sort(order_.begin(), order_.begin() + 2 * kMost, order_.end(),
                    [&](std::int32_t a, std::int32_t b) {
                      return votes(a) != votes(b) ? votes(a) > votes(b) : a < b;
                    });
  shifts_.clear();
  for (std::size_t i = 0; i < 2 * kMost && shifts_.size() < kMost; ++i) {
    const Bin& bin = bins_[static_cast<std::size_t>(order_[i])];
    if (bin.votes == 0) break;
    const auto count = static_cast<float>(bin.votes);
    const cv::Point2f shift(bin.x / count, bin.y / count);
    if (shift.dot(shift) > kOwn * kOwn) shifts_.push_back(shift);
  }
  return shifts_;
}

}  // namespace ktgp_orb::growth
