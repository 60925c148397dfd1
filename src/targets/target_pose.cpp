#include "ktgp_orb/target_pose.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "homography/fit.h"
#include "homography/transform.h"
#include "util/camera_check.h"
#include "util/keypoint_position.h"

namespace ktgp_orb {
namespace {

// Largest squared error of a fitted pose (see PlanarPose) that agrees with the covariance; if the
// error is larger, the covariance is too small. The limit is the 99 % quantile of chi-square with
// two degrees of freedom.
constexpr double kMostMisfit = 9.21;

/// Chooses points so that any two of them are at least `apart` px apart, in x or in y. Returns
/// their indices.
std::vector<std::size_t> chooseApart(const std::vector<Eigen::Vector2d>& points, double apart) {
  std::vector<std::size_t> chosen;
  chosen.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto is_near = [&](std::size_t other) {
      return (points[i] - points[other]).lpNorm<Eigen::Infinity>() < apart;
    };
    if (std::none_of(chosen.begin(), chosen.end(), is_near)) chosen.push_back(i);
  }
  return chosen;
}

/// Largest standard deviation of a mapped corner of an image of this size, px.
double deviationOf(const UncertainHomography& found, const cv::Size& size) {
  return homography::cornerDeviation(found.homography, found.covariance,
                                     homography::imageCorners(size, {}))
      .target;
}

}  // namespace

struct TargetPose::Impl {
  struct Seen {
    std::string id;
    int instance = 0;
    std::size_t image = 0;
    std::int64_t stamp = 0;
    int rows = 0;
    Eigen::Matrix3d camera;
    UncertainHomography answer;
  };

  std::optional<UncertainHomography> rectified(const DetectedTarget& target, const Lens& lens);
  std::optional<UncertainHomography> fitted(const DetectedTarget& target);
  void correctShutter(const DetectedTarget& target, const Eigen::Matrix3d& camera,
                      std::int64_t stamp, int rows, UncertainHomography& answer);

  double readout_time = -1.0;
  std::vector<Seen> seen;  // recent detections, one per instance of a target
  ProsacHomography prosac;
  ProsacResult result;
  PointPairs pairs;
  std::vector<cv::KeyPoint> points;
  homography::HomographyRefiner refiner;
};

/// Removes the lens distortion from the target's point pairs, and fits a homography to them.
/// Returns nothing if the pairs do not agree on a homography.
std::optional<UncertainHomography> TargetPose::Impl::rectified(const DetectedTarget& target,
                                                               const Lens& lens) {
  points.clear();
  for (const Eigen::Vector2d& p : target.pairs.target) {
    points.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), 1.F);
  }
  const std::optional<UncertainHomography> distorted = fitted(target);
  lens.rectify(points);
  std::optional<UncertainHomography> found = fitted(target);
  if (!found || !distorted) return found;
  // The finder's covariance also contains errors that a fit to the pairs does not show: blur and
  // vibration displace many of them together.
  const double ratio = deviationOf(target.homography, target.image_size) /
                       deviationOf(*distorted, target.image_size);
  if (ratio > 1.0 && std::isfinite(ratio)) found->covariance *= ratio * ratio;
  return found;
}

/// Fits a homography to the pairs of the target, whose positions in the frame are in `points`.
std::optional<UncertainHomography> TargetPose::Impl::fitted(const DetectedTarget& target) {
  constexpr double kPatchSide = 15.0;  // approximate side of a patch, px
  // Overlapping patches of the alignment share their noise, so only one of them counts.
  const double apart = target.aligned ? kPatchSide : 0.0;
  pairs.clear();
  pairs.rounding = target.aligned ? 0.0 : util::kKeypointRounding;
  for (const std::size_t i : chooseApart(target.pairs.target, apart)) {
    if (std::isnan(points[i].pt.x)) continue;  // the lens model does not cover this point
    pairs.add(target.pairs.reference[i], {points[i].pt.x, points[i].pt.y}, target.pairs.quality[i]);
  }
  prosac.estimate(pairs, target.image_size, target.homography.homography, result);
  if (result.status != Status::ok) return std::nullopt;
  if (target.aligned) {
    const auto evidence =
        homography::evidenceOfPatches(prosac.options().max_error, target.image_size);
    refiner.refine(pairs.reference, pairs.target, target.image_size, evidence, result.answer);
  }
  return result.answer;
}

void TargetPose::Impl::correctShutter(const DetectedTarget& target, const Eigen::Matrix3d& camera,
                                      std::int64_t stamp, int rows, UncertainHomography& answer) {
  // Maximum age, s, of the previous detection from which we compute how the camera moves. After a
  // longer time, a hand-held camera may have changed its speed.
  constexpr double kLongest = 0.2;
  const auto age = [&](const Seen& one) { return 1e-9 * static_cast<double>(stamp - one.stamp); };
  seen.erase(std::remove_if(seen.begin(), seen.end(),
                            [&](const Seen& one) { return !(std::abs(age(one)) < kLongest); }),
             seen.end());
  Seen now{target.id, target.instance, target.image, stamp, rows, camera, answer};
  const auto last = std::find_if(seen.begin(), seen.end(), [&](const Seen& one) {
    return one.id == now.id && one.instance == now.instance;
  });
  if (last == seen.end()) {
    seen.push_back(std::move(now));
    return;
  }
  // In px of another image size or camera, the difference of the homographies is no motion.
  const bool same_camera = last->rows == rows && last->camera == camera;
  if (target.age > 1 && last->image == now.image && same_camera && age(*last) > 0.0) {
    answer =
        withoutShutter(answer, last->answer, age(*last), readout_time, target.image_size, rows);
  }
  *last = std::move(now);
}

TargetPose::TargetPose(double readout_time) : impl_(std::make_unique<Impl>()) {
  setReadoutTime(readout_time);
}

TargetPose::~TargetPose() = default;
TargetPose::TargetPose(TargetPose&&) noexcept = default;
TargetPose& TargetPose::operator=(TargetPose&&) noexcept = default;

void TargetPose::setReadoutTime(double seconds) {
  util::requireReadoutTime(seconds);
  impl_->readout_time = seconds;
}

double TargetPose::readoutTime() const {
  return impl_->readout_time;
}

PlanarPoses TargetPose::find(const DetectedTarget& target, const Eigen::Matrix3d& camera,
                             const Lens* lens, std::int64_t stamp, int rows) {
  UncertainHomography found = target.homography;
  if (lens != nullptr) {
    const auto rectified = impl_->rectified(target, *lens);
    if (!rectified) return {{}, "its pairs do not agree without the distortion"};
    found = *rectified;
  }
  const Covariance8 noise = found.covariance;
  if (impl_->readout_time != 0.0) impl_->correctShutter(target, camera, stamp, rows, found);
  const auto poses_of = [&](const Covariance8& covariance) {
    return planarPoses(found.homography, covariance, camera, target.image_size, target.width);
  };
  PlanarPoses poses = poses_of(found.covariance);
  if (impl_->readout_time != -1.0) return poses;
  // The readout time is unknown, so the covariance of `found` also allows for a distortion by the
  // shutter. If there are other large errors, the fit of the pose attributes them to the shutter,
  // too, and may find no pose. So if the errors are larger than the covariance explains, we enlarge
  // the noise in the covariance and fit the pose again.
  const PlanarPoses fitted = poses.poses.empty() ? poses_of(noise) : poses;
  if (fitted.poses.empty()) return poses;
  const double misfit = fitted.poses[0].squared_error / kMostMisfit;
  return misfit > 1.0 ? poses_of(found.covariance + (misfit - 1.0) * noise) : poses;
}

}  // namespace ktgp_orb
