#include "mosaic/keyframes.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "homography/transform.h"

namespace ktgp_orb::mosaic {
namespace {

constexpr std::size_t kTriesOnPath = 2;
constexpr std::size_t kTriesLost = 4;
constexpr double kLeastOverlap = 0.2;
// A match gives the position of a frame only if it has at least this many inliers. The limit is
// larger than for a valid match, because the frame may become a keyframe, whose position is never
// corrected.
constexpr std::size_t kLeastInliers = 30;

}  // namespace

/// Returns the share of the frame that the keyframe covers.
double Keyframes::overlap(const Keyframe& keyframe, const cv::Size& size,
                          const Eigen::Matrix3d& from_map) const {
  const Eigen::Matrix3d to_keyframe = keyframe.from_map * from_map.inverse();
  const auto corners = homography::imageCorners(size, {});
  if (!homography::keepsPlaneInView(to_keyframe / to_keyframe(2, 2), corners)) return 0.0;
  // Projects the keyframe's corners into the frame, so that the area is in px of the frame.
  const Eigen::Matrix3d to_frame = to_keyframe.inverse();
  const auto keyframe_corners = homography::imageCorners(keyframe.features.image_size, {});
  if (!homography::keepsPlaneInView(to_frame / to_frame(2, 2), keyframe_corners)) return 0.0;
  std::vector<cv::Point2f> frame;
  std::vector<cv::Point2f> other;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector2d p = (to_frame * keyframe_corners[i].homogeneous()).hnormalized();
    frame.emplace_back(static_cast<float>(corners[i].x()), static_cast<float>(corners[i].y()));
    other.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  }
  std::vector<cv::Point2f> common;
  const double area = cv::intersectConvexConvex(frame, other, common);
  return area / static_cast<double>(std::max(1, size.area()));
}

double Keyframes::coverage(const cv::Size& size, const Eigen::Matrix3d& from_map) const {
  double best = 0.0;
  for (const Keyframe& keyframe : keyframes_) {
    best = std::max(best, overlap(keyframe, size, from_map));
  }
  return best;
}

std::vector<Eigen::Matrix3d> Keyframes::locate(const Features& features,
                                               const Eigen::Matrix3d& expected, bool chained) {
  std::vector<Eigen::Matrix3d> places;
  std::vector<std::pair<double, const Keyframe*>> candidates;
  for (const Keyframe& keyframe : keyframes_) {
    candidates.emplace_back(overlap(keyframe, features.image_size, expected), &keyframe);
  }
  const std::size_t tries = std::min(candidates.size(), chained ? kTriesOnPath : kTriesLost);
  std::partial_sort(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(tries),
                    candidates.end(),
                    [](const auto& a, const auto& b) { return a.first > b.first; });
  for (std::size_t i = 0; i < tries; ++i) {
    const auto& [share, keyframe] = candidates[i];
    if (chained && share < kLeastOverlap) break;
    const Eigen::Matrix3d guess = expected * keyframe->from_map.inverse();
    MatchHints hints;
    if (chained) hints.prediction = guess / guess(2, 2);
    matcher_.match(keyframe->features, features, hints, result_);
    if (result_.homographyStatus() != Status::ok || result_.inliers < kLeastInliers) continue;
    constexpr double kFrames = 20.0;  // length of the running mean, in matches
    plane_deviation_ += (result_.answer.plane_deviation - plane_deviation_) / kFrames;
    places.emplace_back(result_.answer.homography * keyframe->from_map);
    if (chained) break;
  }
  return places;
}

void Keyframes::move(const std::function<Eigen::Matrix3d(const Eigen::Matrix3d&)>& to) {
  for (Keyframe& keyframe : keyframes_) keyframe.from_map = to(keyframe.from_map);
}

void Keyframes::clear() {
  keyframes_.clear();
  plane_deviation_ = 0.0;
}

void Keyframes::add(Features features, const Eigen::Matrix3d& from_map) {
  keyframes_.push_back({std::move(features), from_map});
}

}  // namespace ktgp_orb::mosaic
