#include "growth/alike_pairs.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <utility>

#include "util/keypoint_position.h"

namespace ktgp_orb::growth {
namespace {

/// Returns the smallest and the largest size of the keypoints, px; {0, 0} if there are none.
std::pair<double, double> sizesOf(const Features& features) {
  if (features.empty()) return {0.0, 0.0};
  const auto [least, most] = std::minmax_element(
      features.keypoints.begin(), features.keypoints.end(),
      [](const cv::KeyPoint& a, const cv::KeyPoint& b) { return a.size < b.size; });
  return {least->size, most->size};
}

}  // namespace

void AlikePairs::choose(const Features& features, double least, double most, Part& part) {
  part.indices.clear();
  part.descriptors.clear();
  for (std::size_t i = 0; i < features.size(); ++i) {
    const double size = features.keypoints[i].size;
    if (size < least || size > most) continue;
    part.indices.push_back(static_cast<std::int32_t>(i));
    const std::uint8_t* bits = features.descriptors.ptr(static_cast<int>(i));
    part.descriptors.insert(part.descriptors.end(), bits, bits + kDescriptorBytes);
  }
}

void AlikePairs::find(const Features& reference, const Features& target, double scale,
                      PointPairs& pairs) {
  // Factor by which the range of sizes is widened at each end, because `scale` is an estimate, and
  // the true scale varies within an image. Descriptors tolerate this: they still match if the size
  // of a keypoint is wrong by up to an octave.
  constexpr double kMargin = 1.2;
  const auto [least, most] = sizesOf(reference);
  const auto [least_of_target, most_of_target] = sizesOf(target);
  choose(reference, least_of_target / (kMargin * scale), kMargin * most_of_target / scale,
         parts_[0]);
  choose(target, least * scale / kMargin, kMargin * most * scale, parts_[1]);
  const auto rows = [](Part& part) {
    return cv::Mat(static_cast<int>(part.indices.size()), kDescriptorBytes, CV_8U,
                   part.descriptors.data());
  };
  pairs.clear();
  knn_.matchMutual(rows(parts_[0]), rows(parts_[1]), matches_);
  for (const Correspondence& c : matches_) {
    if (!c.mutual || c.reference_index < 0) continue;
    const auto index = [](const Part& part, std::int32_t of_part) {
      return part.indices[static_cast<std::size_t>(of_part)];
    };
    pairs.add(util::position(reference, index(parts_[0], c.reference_index)),
              util::position(target, index(parts_[1], c.target_index)), c.ratio());
  }
}

}  // namespace ktgp_orb::growth
