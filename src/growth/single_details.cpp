#include "growth/single_details.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "homography/part_in_view.h"

namespace ktgp_orb::growth {
namespace {

void copyBits(const Features& features, std::vector<Bits>& bits) {
  bits.resize(features.size());
  for (std::size_t i = 0; i < bits.size(); ++i) bits[i] = bitsOf(features, i);
}

float squaredLength(const cv::Point2f& p) {
  return p.dot(p);
}

}  // namespace

void SingleDetails::setFrames(const Features& reference, const Features& target) {
  reference_ = &reference;
  target_ = &target;
  is_prepared_ = false;
}

void SingleDetails::prepare() {
  copyBits(*reference_, bits_);
  copyBits(*target_, target_bits_);
  elsewhere_.assign(reference_->size(), -1);
  cells_.build(
      target_->size(), [&](std::size_t i) { return target_->keypoints[i].pt; }, target_->image_size,
      2.0 * kRadius);
  is_prepared_ = true;
}

/// Returns the Hamming distance of a keypoint to the most similar keypoint elsewhere in the
/// reference; 0 if the keypoint is no single detail.
int SingleDetails::nearestElsewhere(std::size_t index) {
  // Keypoints nearer than this may show the same detail, for example on another octave. px.
  constexpr float kElsewhere = 15.F;
  int& known = elsewhere_[index];
  if (known >= 0) return known;
  const std::vector<cv::KeyPoint>& keypoints = reference_->keypoints;
  int nearest = 8 * kDescriptorBytes;
  for (std::size_t i = 0; i < bits_.size() && nearest >= kSingle; ++i) {
    const int d = distance(bits_[index], bits_[i]);
    if (d >= nearest) continue;
    if (squaredLength(keypoints[i].pt - keypoints[index].pt) >= kElsewhere * kElsewhere)
      nearest = d;
  }
  known = nearest < kSingle ? 0 : nearest;
  return known;
}

std::optional<SingleDetails::Count> SingleDetails::count(const Eigen::Matrix3d& map) {
  if (!is_prepared_) prepare();
  const Eigen::Matrix3d view = homography::facing(map);
  double copied = 0.0;
  Count single{0.0, 0.0};
  for (std::size_t i = 0; i < bits_.size(); ++i) {
    const cv::Point2f& from = reference_->keypoints[i].pt;
    const Eigen::Vector3d p = view * Eigen::Vector3d(from.x, from.y, 1.0);
    if (!(p.z() > 0.0)) continue;
    const cv::Point2f to(static_cast<float>(p.x() / p.z()), static_cast<float>(p.y() / p.z()));
    int nearest = -1;
    cells_.visitNear(to.x, to.y, kRadius, [&](std::int32_t other) {
      const auto j = static_cast<std::size_t>(other);
      if (!(squaredLength(target_->keypoints[j].pt - to) < kRadius * kRadius)) return;
      const int d = distance(bits_[i], target_bits_[j]);
      nearest = nearest < 0 ? d : std::min(nearest, d);
    });
    if (nearest < 0) continue;
    const int elsewhere = nearestElsewhere(i);
    (elsewhere == 0 ? copied : single.seen) += 1.0;
    single.found += nearest < elsewhere ? 1.0 : 0.0;
  }
  if (single.seen >= copied) return std::nullopt;
  return single;
}

// Measured share of the single details that are found, less one standard deviation: at most 0.08 on
// drawn pages that have only their symbols in common, at least 0.11 with the right homography.
bool SingleDetails::Count::contradict() const {
  constexpr double kFewest = 0.1;
  return found - std::sqrt(found) < kFewest * seen;
}

// Neighbouring keypoints show the same detail: if two labels begin with the same digits, several
// keypoints agree. So the standard deviation is computed as if kTogether details were one.
bool SingleDetails::Count::settle() const {
  constexpr double kDecisive = 0.2;
  constexpr double kTogether = 8.0;
  return found - std::sqrt(kTogether * found) >= kDecisive * seen;
}

}  // namespace ktgp_orb::growth
