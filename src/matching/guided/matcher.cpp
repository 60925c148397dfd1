#include "ktgp_orb/guided_matcher.h"

#include <algorithm>
#include <cstdint>
#include <limits>

#include "homography/fit.h"
#include "homography/part_in_view.h"
#include "matching/knn/near_search.h"
#include "matching/standing/standing.h"
#include "util/keypoint_position.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

using util::position;

constexpr int kNoDistance = 256;

}  // namespace

struct GuidedMatcher::Impl {
  void placeReference(const Features& reference, const Eigen::Matrix3d& homography);
  void findNearest(const Features& reference, const Features& target);
  std::size_t supporters(const Eigen::Matrix3d& homography, double threshold) const;
  bool estimate(const cv::Size& reference_size, double threshold, bool by_cell,
                UncertainHomography& estimate);

  GuidedOptions options;
  knn::KnnKernel kernel = knn::bestKnnKernel();
  std::vector<cv::Point2f> places;  // predicted positions of the reference's keypoints
  knn::NearTable table;             // predicted positions, sorted into cells for the search
  // Keys of the two most similar reference keypoints, for each target keypoint.
  std::vector<knn::NearKeys> of_target;
  // For each reference keypoint, the key of the most similar target keypoint; the index is
  // table.column(keypoint).
  std::vector<std::int32_t> nearest_target;
  homography::HomographyRefiner refiner;
  std::vector<Eigen::Vector2d> reference_points;  // reference position of each match
  std::vector<Eigen::Vector2d> target_points;
};

GuidedMatcher::GuidedMatcher(const GuidedOptions& options) : impl_(std::make_unique<Impl>()) {
  util::requireInRange("guided_radius", options.radius, 0.1, 100.0);
  util::requireInRange("guided max_distance", options.max_distance, 0, kNoDistance);
  impl_->options = options;
}

GuidedMatcher::~GuidedMatcher() = default;
GuidedMatcher::GuidedMatcher(GuidedMatcher&&) noexcept = default;
GuidedMatcher& GuidedMatcher::operator=(GuidedMatcher&&) noexcept = default;

const GuidedOptions& GuidedMatcher::options() const {
  return impl_->options;
}

void GuidedMatcher::match(const Features& reference, const Features& target,
                          const Eigen::Matrix3d& homography, std::vector<Correspondence>& matches) {
  requireValid(reference, "reference");
  requireValid(target, "target");
  requireSameDescriptor(reference, target);
  knn::requireCountable(reference, "reference");
  knn::requireCountable(target, "target");
  matches.clear();
  Impl& impl = *impl_;
  if (!impl.options.enabled) return;
  impl.placeReference(reference, homography);
  impl.findNearest(reference, target);
  for (std::size_t t = 0; t < target.size(); ++t) {
    const knn::NearKeys& keys = impl.of_target[t];
    const int distance = keys.best >> knn::kNearIndexBits;
    if (keys.best == knn::kNoNearKey || distance > impl.options.max_distance) continue;
    const std::int32_t nearest = keys.best & knn::kNearIndexMask;
    const auto index = static_cast<std::int32_t>(t);
    if ((impl.nearest_target[impl.table.column(nearest)] & knn::kNearIndexMask) != index) continue;
    matches.push_back({nearest, index, distance,
                       std::min(keys.second >> knn::kNearIndexBits, kNoDistance), Level::guided});
  }
}

void GuidedMatcher::Impl::placeReference(const Features& reference,
                                         const Eigen::Matrix3d& homography) {
  const Eigen::Matrix3d h = homography::facing(homography);
  constexpr double kFar = 1e6;  // px
  constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();
  places.resize(reference.size());
  for (std::size_t i = 0; i < reference.size(); ++i) {
    const Eigen::Vector2d x = position(reference, static_cast<std::int32_t>(i));
    const Eigen::Vector3d p = h * Eigen::Vector3d(x.x(), x.y(), 1.0);
    const Eigen::Vector2d place = p.head<2>() / p.z();
    // This form of the comparison also excludes values that are not finite.
    const bool seen = p.z() > 0.0 && place.cwiseAbs().maxCoeff() < kFar;
    places[i].x = seen ? static_cast<float>(place.x()) : kNowhere;
    places[i].y = seen ? static_cast<float>(place.y()) : kNowhere;
  }
}

void GuidedMatcher::Impl::findNearest(const Features& reference, const Features& target) {
  table.build(
      reference, [&](std::size_t i) { return places[i]; }, target.image_size, options.radius);
  nearest_target.assign(table.columns(), knn::kNoNearKey);
  of_target.resize(target.size());
  for (std::size_t t = 0; t < target.size(); ++t) {
    const auto index = static_cast<std::int32_t>(t);
    of_target[t] =
        table.search(kernel, target.descriptors.ptr(index), util::imagePoint(target, index),
                     options.radius, index, nearest_target.data());
  }
}

bool GuidedMatcher::refine(const Features& reference, const Features& target, double threshold,
                           bool by_cell, UncertainHomography& estimate,
                           std::vector<Correspondence>& matches) {
  Impl& impl = *impl_;
  match(reference, target, estimate.homography, matches);
  matching::Standing::erase(estimate.homography, reference, target, matches);
  impl.reference_points.clear();
  impl.target_points.clear();
  for (const Correspondence& c : matches) {
    impl.reference_points.push_back(position(reference, c.reference_index));
    impl.target_points.push_back(position(target, c.target_index));
  }
  return impl.estimate(reference.image_size, threshold, by_cell, estimate);
}

bool GuidedMatcher::Impl::estimate(const cv::Size& reference_size, double threshold, bool by_cell,
                                   UncertainHomography& estimate) {
  UncertainHomography candidate = estimate;
  const auto evidence = homography::evidenceOfKeypoints(threshold, by_cell);
  if (!refiner.refine(reference_points, target_points, reference_size, evidence, candidate)) {
    return false;
  }
  const auto corners = homography::imageCorners(reference_size, reference_points);
  const auto shows_all = [&](const UncertainHomography& answer) {
    return homography::keepsPlaneInView(homography::facing(answer.homography), corners);
  };
  if (shows_all(estimate) && !shows_all(candidate)) return false;
  // Reject the candidate if it has fewer supporters than the old estimate or, with by_cell, fewer
  // than half as many.
  const std::size_t share = by_cell ? 2 : 1;
  if (share * supporters(candidate.homography, threshold) <
      supporters(estimate.homography, threshold)) {
    return false;
  }
  estimate = candidate;
  return true;
}

std::size_t GuidedMatcher::Impl::supporters(const Eigen::Matrix3d& homography,
                                            double threshold) const {
  std::size_t count = 0;
  for (std::size_t i = 0; i < reference_points.size(); ++i) {
    if (homography::errorOf(homography, reference_points[i], target_points[i]) < threshold) ++count;
  }
  return count;
}

}  // namespace ktgp_orb
