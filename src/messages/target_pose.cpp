#include "messages/target_pose.h"

#include <ktgp_orb/MatchStatus.h>

#include <vector>

namespace ktgp_orb {
namespace {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using RowMajor8 = Eigen::Matrix<double, 8, 8, Eigen::RowMajor>;

constexpr std::size_t kEnoughAligned = 50;

cv::KeyPoint keypoint(const Eigen::Vector2d& point) {
  return {static_cast<float>(point.x()), static_cast<float>(point.y()), 1.0F};
}

void append(const std::vector<cv::KeyPoint>& points, std::vector<Eigen::Vector2d>& pairs) {
  for (const cv::KeyPoint& point : points) pairs.emplace_back(point.pt.x, point.pt.y);
}

}  // namespace

void TargetPose::setOptions(const ProsacOptions& options) {
  const ProsacOptions& now = prosac_.options();
  if (options.max_error == now.max_error && options.max_iterations == now.max_iterations &&
      options.confidence == now.confidence && options.seed == now.seed) {
    return;  // keep the buffers
  }
  prosac_ = ProsacHomography(options);
}

std::optional<PlanarPose> TargetPose::find(const FrameMessages& messages, const PixelCamera& camera,
                                           double width) {
  if (!messages.correspondences || messages.homography->status != MatchStatus::STATUS_OK) {
    return std::nullopt;
  }
  const cv::Size reference(static_cast<int>(messages.correspondences->reference_width),
                           static_cast<int>(messages.correspondences->reference_height));
  if (!camera.lens) {
    const HomographyStamped& found = *messages.homography;
    return planarPose(Eigen::Map<const RowMajor3>(found.homography.data()),
                      Eigen::Map<const RowMajor8>(found.covariance.data()), camera.camera,
                      reference, width);
  }
  undistort(messages, *camera.lens);
  prosac_.estimate(pairs_, reference, result_);
  if (result_.status != Status::ok) return std::nullopt;
  const UncertainHomography found = homographyOfPairs(reference);
  return planarPose(found.homography, found.covariance, camera.camera, reference, width);
}

/// The homography of `result_`; aligned points are fitted like in the alignment, since their errors
/// differ from those of keypoints.
UncertainHomography TargetPose::homographyOfPairs(const cv::Size& reference) {
  UncertainHomography found{result_.homography, result_.covariance, result_.shared_covariance,
                            result_.plane_deviation};
  if (!of_patches_) return found;
  const auto evidence = homography::evidenceOfPatches(prosac_.options().max_error, reference);
  UncertainHomography refined = found;
  if (!refiner_.refine(pairs_.reference, pairs_.target, reference, evidence, refined)) return found;
  finaliser_.finalise(refined, pairs_, reference, evidence.max_error, final_);
  return final_.trusted ? refined : found;
}

// The aligned points if there are enough, accurate to hundredths of a pixel; else the matches that
// passed GMS.
void TargetPose::undistort(const FrameMessages& messages, const Lens& lens) {
  const Correspondences& matches = *messages.correspondences;
  std::vector<cv::KeyPoint> reference;
  std::vector<cv::KeyPoint> target;
  pairs_.clear();
  of_patches_ =
      messages.alignment != nullptr && messages.alignment->points.size() >= kEnoughAligned;
  if (of_patches_) {
    for (const AlignedPoint& point : messages.alignment->points) {
      reference.push_back(keypoint(point.reference));
      target.push_back(keypoint(point.target));
      pairs_.quality.push_back(0.5);  // all are equally good
    }
  } else {
    for (std::size_t i = 0; i < matches.level.size(); ++i) {
      if (matches.level[i] < Correspondences::LEVEL_KTG) continue;
      reference.emplace_back(matches.reference_x[i], matches.reference_y[i], 1.0F);
      target.emplace_back(matches.target_x[i], matches.target_y[i], 1.0F);
      pairs_.quality.push_back(matches.ratio[i]);
    }
  }
  lens.rectify(target);
  if (messages.reference_of_camera) lens.rectify(reference);
  append(reference, pairs_.reference);
  append(target, pairs_.target);
}

}  // namespace ktgp_orb
