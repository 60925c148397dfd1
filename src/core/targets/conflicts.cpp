#include "core/targets/conflicts.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "core/homography/transform.h"

namespace ktgp_orb::targets {
namespace {

/// Number of keypoints that both explain. `sorted`: of the other one.
std::size_t shared(const FoundTarget& one, const std::vector<std::int32_t>& sorted) {
  std::size_t count = 0;
  for (const std::int32_t keypoint : one.found.keypoints) {
    count += std::binary_search(sorted.begin(), sorted.end(), keypoint) ? 1 : 0;
  }
  return count;
}

/// Whether the points that it was found by reach over most of the picture.
bool coversPicture(const FoundTarget& one, TargetStore& store) {
  constexpr double kShare = 0.4;  // of the area
  const cv::Size size = store.picture(one.picture).image.size();
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : one.found.pairs.reference) box.extend(p);
  return box.volume() > kShare * size.area();
}

std::vector<cv::Point2f> outlineOf(const FoundTarget& one, TargetStore& store) {
  std::vector<cv::Point2f> outline;
  for (const Eigen::Vector2d& p :
       homography::imageCorners(store.picture(one.picture).image.size(), {})) {
    const Eigen::Vector2d q = homography::project(one.found.estimate.homography, p);
    outline.emplace_back(static_cast<float>(q.x()), static_cast<float>(q.y()));
  }
  return outline;
}

/// Whether both cover nearly the same part of the frame.
bool areInOnePlace(const FoundTarget& one, const FoundTarget& other, TargetStore& store) {
  constexpr double kShare = 0.5;
  const std::vector<cv::Point2f> a = outlineOf(one, store);
  const std::vector<cv::Point2f> b = outlineOf(other, store);
  std::vector<cv::Point2f> common;
  return cv::intersectConvexConvex(a, b, common) >
         kShare * std::max(cv::contourArea(a), cv::contourArea(b));
}

}  // namespace

std::vector<std::uint8_t> conflicts(const std::vector<FoundTarget>& found, TargetStore& store) {
  constexpr double kMost = 0.7;
  std::vector<std::uint8_t> is_doubtful(found.size(), 0);
  std::vector<std::int32_t> sorted;
  for (std::size_t i = 0; i < found.size(); ++i) {
    sorted = found[i].found.keypoints;
    std::sort(sorted.begin(), sorted.end());
    for (std::size_t j = 0; j < found.size(); ++j) {
      const std::size_t count = found[j].found.keypoints.size();
      if (found[j].target == found[i].target || count > sorted.size()) continue;
      const bool are_shared =
          static_cast<double>(shared(found[j], sorted)) >= kMost * static_cast<double>(count);
      if ((are_shared && !coversPicture(found[j], store)) ||
          areInOnePlace(found[i], found[j], store)) {
        is_doubtful[j] = 1;
      }
    }
  }
  return is_doubtful;
}

}  // namespace ktgp_orb::targets
