#include "targets/picture_search.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "growth/map_fit.h"
#include "homography/transform.h"

namespace ktgp_orb::targets {
namespace {

using growth::Grower;
using growth::kTargetPlan;

// Search radius after a fit to many seeds, px. It is small, because such a fit predicts positions
// better than one seed.
constexpr float kRadiusAfterFit = 7.F;

/// Returns true if the homography shows the whole picture from its front, as a real view does.
bool isView(const Eigen::Matrix3d& homography, const TargetPicture& picture) {
  return homography::keepsPlaneInView(homography,
                                      homography::imageCorners(picture.image.size(), {}));
}

}  // namespace

void PictureSearch::setFrame(const Features& features, const std::vector<std::int32_t>& numbers,
                             const FramePyramid& frame) {
  matcher_.setTarget(features);
  frame_ = frame;
  numbers_ = numbers;
}

bool PictureSearch::isExplained(const Seed& seed) const {
  constexpr double kNear = 10.0;  // px
  // A seed is explained if it agrees with at least this many of the homographies that earlier seeds
  // have grown to. We ask for two, because one homography alone may be wrong.
  constexpr std::ptrdiff_t kTwice = 2;
  return std::count_if(tried_.begin(), tried_.end(), [&](const Eigen::Matrix3d& map) {
           return homography::errorOf(map, seed.from(), seed.to()) < kNear;
         }) >= kTwice;
}

bool PictureSearch::fromSeeds(TargetPicture& picture, const std::vector<Seed>& seeds,
                              std::size_t pictures, FoundTarget& found) {
  tried_.clear();
  int count = 0;
  for (const Seed& seed : seeds) {
    if (count == kMostSeeds) return false;
    if (isExplained(seed)) continue;
    ++count;
    const Eigen::Vector2d centre = seed.from();
    const Eigen::Matrix3d affine = affineOf(seed, seeds);
    Eigen::Matrix3d map = affine;
    if (fitSeeds(seeds, map) &&
        grower_.settle(centre, kRadiusAfterFit, picture.frames, matcher_, map) &&
        accept(picture, map, pictures, found)) {
      return true;
    }
    if (grow(picture, centre, pictures, affine, found)) return true;
    if (growByImages(picture, centre, pictures, affine, found)) return true;
  }
  return false;
}

/// If many seeds agree, fits the homography to them at once, without growth from a single seed.
bool PictureSearch::fitSeeds(const std::vector<Seed>& seeds, Eigen::Matrix3d& map) {
  constexpr std::size_t kMany = 24;
  for (const float radius : {kTargetPlan.first_radius, 0.5F * kTargetPlan.first_radius}) {
    seed_pairs_.clear();
    for (const Seed& seed : seeds) {
      if (homography::errorOf(map, seed.from(), seed.to()) < radius) {
        seed_pairs_.add(seed.from(), seed.to(), 0.0);
      }
    }
    if (seed_pairs_.size() < kMany || !growth::refit(seed_pairs_, radius, map)) return false;
  }
  return true;
}

/// A followed picture needs weaker evidence than a picture found by searching the whole frame for
/// all pictures, because a false alarm is less likely: it would have to lie within the radius and
/// to look more like the picture than the places around it.
bool PictureSearch::follow(TargetPicture& picture, const Eigen::Matrix3d& prediction, double radius,
                           FoundTarget& found) {
  constexpr double kPlaces = 100.0;  // number of independent places within the radius
  if (frame_.levels.empty()) return false;
  aligned_ = {};
  if (!appearance_.locate(picture, prediction, frame_, radius, aligned_.homography) ||
      !aligner_.align(picture, frame_.levels, aligned_, aligned_pairs_) ||
      !isView(aligned_.homography, picture)) {
    return false;
  }
  grower_.search(aligned_.homography, middleOf(picture.image.size()), Grower::kEverywhere,
                 Grower::kLastRadius, picture.frames, matcher_);
  takePairs(found);
  found.estimate = aligned_;
  found.aligned = true;
  std::swap(found.pairs, aligned_pairs_);
  const Appearance::Similarity seen = appearance_.compare(
      picture, aligned_.homography, frame_, kPlaces, Appearance::kAboveNeighboursOfTrack);
  found.log_false_alarms = seen.log_false_alarms;
  found.agreement = seen.agreement;
  return found.log_false_alarms < kLogMaxOfTrack;
}

bool PictureSearch::grow(TargetPicture& picture, const Eigen::Vector2d& centre,
                         std::size_t pictures, Eigen::Matrix3d map, FoundTarget& found) {
  if (!grower_.grow(centre, picture.frames, matcher_, map)) return false;
  tried_.push_back(map);
  return accept(picture, map, pictures, found);
}

/// Grows the homography from the patches around the seed to the whole picture. This helps if the
/// picture has few keypoints, or if few of them are found in this view.
bool PictureSearch::growByImages(TargetPicture& picture, const Eigen::Vector2d& centre,
                                 std::size_t pictures, const Eigen::Matrix3d& map,
                                 FoundTarget& found) {
  if (frame_.levels.empty() ||
      !aligner_.grow(picture, frame_.levels, centre, map, found.estimate)) {
    return false;
  }
  if (!isView(found.estimate.homography, picture)) return false;
  if (!grower_.search(found.estimate.homography, centre, Grower::kEverywhere, Grower::kLastRadius,
                      picture.frames, matcher_)) {
    return false;
  }
  takePairs(found);
  return isSeen(picture, pictures, found);
}

/// Fits the homography to the pairs that the grower has just found, and judges it by comparing the
/// images. If they do not confirm it, compares its matches with decoys (see growth::Verdict).
bool PictureSearch::accept(TargetPicture& picture, const Eigen::Matrix3d& map, std::size_t pictures,
                           FoundTarget& found) {
  if (!fit(picture, map, found)) return false;
  const cv::Size size = picture.image.size();
  const bool trusted =
      trust_.trusts(found.estimate, found.pairs, size, growth::Verdict::kRadius, labelled_);
  dropOutliers(found);
  if (found.pairs.size() < kTargetPlan.fewest_pairs ||
      !isView(found.estimate.homography, picture)) {
    return false;
  }
  if (isSeen(picture, pictures, found)) return true;
  if (!trusted) return false;
  // The verdict also counts the matches of the same homography after a shift by a period of the
  // scene, such as the distance between two windows. We limit these shifts to 0.6 of the target's
  // shorter side, because a longer shift may lead to another copy of the target beside this one.
  const cv::Size2d seen = sizeIn(map, size);
  const float longest_period = 0.6F * static_cast<float>(std::min(seen.width, seen.height));
  const growth::Judgement judgement =
      verdict_.judge(grower_.predictions(), picture.frames, kTargetPlan.first_radius, kAllSeeds,
                     matcher_, longest_period);
  found.log_false_alarms = judgement.log_false_alarms + std::log10(static_cast<double>(pictures));
  return found.log_false_alarms < kLogMaxFalseAlarms;
}

Appearance::Similarity PictureSearch::similarity(const TargetPicture& picture, std::size_t pictures,
                                                 const FoundTarget& found) {
  const double tests = static_cast<double>(kAllHomographies) * static_cast<double>(pictures);
  if (frame_.levels.empty()) return {};
  return appearance_.compare(picture, found.estimate.homography, frame_, tests);
}

/// Returns true if the images look so similar that chance does not explain it.
bool PictureSearch::isSeen(const TargetPicture& picture, std::size_t pictures, FoundTarget& found) {
  const Appearance::Similarity seen = similarity(picture, pictures, found);
  found.log_false_alarms = seen.log_false_alarms;
  found.agreement = seen.agreement;
  return found.log_false_alarms < kLogMaxFalseAlarms;
}

bool PictureSearch::confirm(const TargetPicture& picture, std::size_t pictures,
                            FoundTarget& found) {
  constexpr double kMuch = 0.6;
  if (found.agreement >= kMuch) return true;
  const Appearance::Similarity seen = similarity(picture, pictures, found);
  found.log_false_alarms = std::min(found.log_false_alarms, seen.log_false_alarms);
  found.agreement = seen.agreement;
  return !seen.differs;
}

/// Fits the homography of maximum likelihood to the pairs that the grower has found. `map`: initial
/// guess, picture -> frame. Returns false if the pairs do not determine the homography.
bool PictureSearch::fit(const TargetPicture& picture, const Eigen::Matrix3d& map,
                        FoundTarget& found) {
  takePairs(found);
  found.estimate = {};
  found.estimate.homography = map / map(2, 2);
  return refiner_.refine(found.pairs.reference, found.pairs.target, picture.image.size(),
                         homography::evidenceOfKeypoints(growth::Verdict::kRadius, true),
                         found.estimate);
}

/// Sets the pairs of `found` to the pairs of the grower's last search.
void PictureSearch::takePairs(FoundTarget& found) const {
  found.aligned = false;
  found.pairs = grower_.pairs();
  found.keypoints.clear();
  for (const growth::LocalMatch& match : grower_.matches()) {
    const std::int32_t keypoint = match.target;
    found.keypoints.push_back(numbers_.empty() ? keypoint
                                               : numbers_[static_cast<std::size_t>(keypoint)]);
  }
}

void PictureSearch::dropOutliers(FoundTarget& found) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < found.pairs.size(); ++i) {
    if (labelled_.mask[i] == 0) continue;
    found.pairs.reference[kept] = found.pairs.reference[i];
    found.pairs.target[kept] = found.pairs.target[i];
    found.pairs.quality[kept] = found.pairs.quality[i];
    found.keypoints[kept++] = found.keypoints[i];
  }
  found.pairs.reference.resize(kept);
  found.pairs.target.resize(kept);
  found.pairs.quality.resize(kept);
  found.keypoints.resize(kept);
}

void PictureSearch::align(const TargetPicture& picture, FoundTarget& found) {
  if (frame_.levels.empty()) return;
  if (alignFrom(found.estimate, picture, found)) return;
  // Keypoints in a small part of the picture do not determine the homography elsewhere, so grow it
  // by aligning patches of the images.
  const Eigen::Matrix3d& map = found.estimate.homography;
  const Eigen::Vector2d centre = growth::middleOf(found.pairs.reference);
  Eigen::Matrix3d affine = Eigen::Matrix3d::Identity();
  affine.topLeftCorner<2, 2>() = homography::jacobianByPoint(map, centre);
  affine.topRightCorner<2, 1>() =
      homography::project(map, centre) - affine.topLeftCorner<2, 2>() * centre;
  UncertainHomography grown;
  if (aligner_.grow(picture, frame_.levels, centre, affine, grown)) {
    alignFrom(grown, picture, found);
  }
}

bool PictureSearch::isDetermined(const TargetPicture& picture, const FoundTarget& found) {
  // Largest allowed standard deviation of a corner, px. It is computed in the frame and in the
  // picture, and the smaller of the two values counts.
  constexpr double kMostDeviation = 5.0;
  const homography::CornerDeviation deviation =
      homography::cornerDeviation(found.estimate.homography, found.estimate.covariance,
                                  homography::imageCorners(picture.image.size(), {}));
  return std::min(deviation.target, deviation.reference) < kMostDeviation;
}

bool PictureSearch::alignFrom(const UncertainHomography& start, const TargetPicture& picture,
                              FoundTarget& found) {
  aligned_ = start;
  if (!aligner_.align(picture, frame_.levels, aligned_, aligned_pairs_) ||
      !isView(aligned_.homography, picture)) {
    return false;
  }
  // Keep the alignment only if at least half of the pairs of keypoints agree with it.
  const std::size_t before = found.pairs.size();
  homography::label(aligned_, found.pairs, growth::Verdict::kRadius, labelled_);
  if (2 * labelled_.inliers < before) return false;
  found.estimate = aligned_;
  found.aligned = true;
  dropOutliers(found);
  std::swap(found.pairs, aligned_pairs_);
  return true;
}

}  // namespace ktgp_orb::targets
