#include "targets/picture_aligner.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "estimation/sandwich.h"
#include "growth/map_fit.h"
#include "homography/transform.h"

namespace ktgp_orb::targets {
namespace {

// Distance between neighbouring patches, px of the small picture (the picture shrunk to its size in
// the frame). It is half the side of a patch.
constexpr double kPatchStep = 8.0;
constexpr double kPatchReach = 4.0;  // largest distance by which a patch may move, px
// Border around the small picture, px, because the alignment reads pixels beside a patch.
constexpr int kMargin = 8;
constexpr std::size_t kFewestPatches = 12;

}  // namespace

PictureAligner::PictureAligner() : aligner_(alignment::bestAlignmentKernels()), small_(1) {}

void PictureAligner::setPicture(const TargetPicture& picture, const Eigen::Matrix3d& homography) {
  const cv::Size whole = picture.image.size();
  const Eigen::Matrix2d jacobian = homography::jacobianByPoint(homography, middleOf(whole));
  const auto side = [](double stretch, int length) {
    return std::max(1, cvRound(std::min(1.0, stretch) * length));
  };
  const cv::Size size(side(jacobian.col(0).norm(), whole.width),
                      side(jacobian.col(1).norm(), whole.height));
  shrink(picture, size, cv::INTER_AREA, shrunk_);
  cv::copyMakeBorder(shrunk_, small_[0], kMargin, kMargin, kMargin, kMargin, cv::BORDER_REPLICATE);
  size_ = size;
}

bool PictureAligner::grow(const TargetPicture& picture, const std::vector<cv::Mat>& frame,
                          const Eigen::Vector2d& centre, const Eigen::Matrix3d& map,
                          UncertainHomography& estimate) {
  constexpr double kFirstReach = 24.0;  // first radius of the growth, px of the small picture
  constexpr double kReachFactor = 1.4;
  constexpr std::size_t kFewestForHomography = 40;
  constexpr double kScale = 1.0;  // error at which a patch has half the weight, px
  setPicture(picture, map);
  aligner_.setImages(small_, frame);
  const Eigen::Matrix3d to_small = homography::resizing(picture.image.size(), size_);
  const Eigen::Vector2d from = homography::project(to_small, centre);
  const double all = std::hypot(size_.width, size_.height);
  Eigen::Matrix3d of_small = map * to_small.inverse();
  for (double reach = kFirstReach; reach < all * kReachFactor; reach *= kReachFactor) {
    if (!alignNear(from, reach, kPatchStep, of_small)) return false;
    const bool is_fitted = (reference_.size() >= kFewestForHomography &&
                            growth::fitHomography(reference_, target_, kScale, of_small)) ||
                           growth::fitAffine(reference_, target_, kScale, of_small);
    if (!is_fitted) return false;
  }
  UncertainHomography grown{of_small / of_small(2, 2)};
  if (!alignNear(from, all, kPatchStep, of_small) || !refine(grown)) return false;
  estimate = homography::chained(grown, {to_small});
  return true;
}

bool PictureAligner::align(const TargetPicture& picture, const std::vector<cv::Mat>& frame,
                           UncertainHomography& estimate, PointPairs& pairs) {
  setPicture(picture, estimate.homography);
  aligner_.setImages(small_, frame);
  const Eigen::Matrix3d to_small = homography::resizing(picture.image.size(), size_);
  const Eigen::Matrix3d to_picture = to_small.inverse();
  UncertainHomography of_small = UncertainHomography{estimate.homography * to_picture};
  of_small.homography /= of_small.homography(2, 2);
  const double all = std::hypot(size_.width, size_.height);
  // Align in two rounds: the first round improves the homography that warps the patches of the
  // second round. A quarter of the patches is enough for the first round, unless the picture is so
  // small that too few patches remain.
  const auto improve = [&](double step) {
    return alignNear({0.0, 0.0}, all, step, of_small.homography) && refine(of_small);
  };
  if (!improve(2.0 * kPatchStep) && !improve(kPatchStep)) return false;
  if (!improve(kPatchStep)) return false;
  addVibration(of_small);
  estimate = homography::chained(of_small, {to_small});
  pairs.clear();
  const double near = nearOf(of_small.homography);
  for (std::size_t i = 0; i < reference_.size(); ++i) {
    if (!(homography::errorOf(of_small.homography, reference_[i], target_[i]) < near)) continue;
    pairs.add(homography::project(to_picture, reference_[i]), target_[i],
              // All pairs get the same quality.
              0.5);
  }
  return true;
}

/// Returns the largest error, px, at which a patch still agrees with the homography. Patches with
/// larger errors were aligned at a wrong place.
double PictureAligner::nearOf(const Eigen::Matrix3d& homography) {
  constexpr double kTimesMedian = 3.0;
  constexpr double kLeast = 0.3;  // px
  errors_.clear();
  for (std::size_t i = 0; i < reference_.size(); ++i) {
    errors_.push_back(homography::errorOf(homography, reference_[i], target_[i]));
  }
  const auto middle = errors_.begin() + static_cast<std::ptrdiff_t>(errors_.size() / 2);
  std::nth_element(errors_.begin(), middle, errors_.end());
  return std::max(kLeast, kTimesMedian * *middle);
}

/// A patch is a square in the frame. Returns true if the patch around `point` (px of the small
/// picture) shows only the picture, nothing beside it. `map`: small picture -> frame.
bool PictureAligner::isInside(const Eigen::Matrix3d& map, const Eigen::Vector2d& point) const {
  constexpr double kHalf = 0.5 * alignment::kPatchSide;
  const Eigen::Matrix2d back = homography::jacobianByPoint(map, point).inverse();
  const Eigen::Vector2d margin = back.cwiseAbs() * Eigen::Vector2d(kHalf, kHalf);
  return point.x() > margin.x() && point.y() > margin.y() &&
         point.x() < size_.width - 1.0 - margin.x() && point.y() < size_.height - 1.0 - margin.y();
}

/// Aligns the patches on a grid with a spacing of `step` px, within `reach` px of `centre` (all in
/// px of the small picture). `map`: small picture -> frame. Returns false if too few patches were
/// found in the frame, in number or as a share of the patches with texture.
bool PictureAligner::alignNear(const Eigen::Vector2d& centre, double reach, double step,
                               const Eigen::Matrix3d& map) {
  constexpr double kLeastShare = 0.3;
  reference_.clear();
  target_.clear();
  std::size_t tried = 0;
  const Eigen::Vector2d border(kMargin, kMargin);
  Eigen::Matrix3d of_bordered = map;
  of_bordered.col(2) -= map.leftCols<2>() * border;
  for (double y = kPatchStep; y < size_.height; y += step) {
    for (double x = kPatchStep; x < size_.width; x += step) {
      const Eigen::Vector2d point(x, y);
      if ((point - centre).squaredNorm() > reach * reach || !isInside(map, point)) continue;
      const alignment::AlignedPatch patch =
          aligner_.align(of_bordered, point + border, kPatchReach);
      using alignment::PatchOutcome;
      if (patch.outcome == PatchOutcome::outside || patch.outcome == PatchOutcome::textureless) {
        continue;
      }
      ++tried;
      if (patch.outcome != PatchOutcome::aligned) continue;
      reference_.push_back(patch.reference - border);
      target_.push_back(patch.target);
    }
  }
  return reference_.size() >= kFewestPatches &&
         static_cast<double>(reference_.size()) >= kLeastShare * static_cast<double>(tried);
}

/// Computes the sums of each band of rows. Returns the sum of the squared errors of all patches, in
/// x and in y, px².
Eigen::Vector2d PictureAligner::sumBands(const Eigen::Matrix3d& homography) {
  // Height of a band, px. A motor's vibration displaces all rows of a band by nearly the same
  // amount, because the camera reads some hundred rows, many more than a band has, during one
  // period.
  constexpr double kBand = 16.0;
  constexpr double kLargest = 3.0;  // px; a larger error is a wrong match
  bands_.clear();
  Eigen::Vector2d squares = Eigen::Vector2d::Zero();
  for (std::size_t i = 0; i < reference_.size(); ++i) {
    const Eigen::Vector2d error = target_[i] - homography::project(homography, reference_[i]);
    if (!(error.norm() < kLargest) || !(target_[i].y() >= 0.0)) continue;
    const auto number = static_cast<std::size_t>(target_[i].y() / kBand);
    if (number >= bands_.size()) bands_.resize(number + 1);
    Band& band = bands_[number];
    const Eigen::Matrix<double, 2, 8> slope =
        homography::jacobianByEntries(homography, reference_[i]);
    band.count += 1.0;
    band.error += error;
    band.slope += slope;
    band.information += slope.transpose() * slope;
    squares += error.cwiseAbs2();
  }
  const auto is_empty = [](const Band& band) { return band.count == 0.0; };
  bands_.erase(std::remove_if(bands_.begin(), bands_.end(), is_empty), bands_.end());
  return squares;
}

/// Adds the errors caused by vibration to the covariance. If a camera with a rolling shutter
/// vibrates, neighbouring rows are displaced together, by more than the noise of their patches. The
/// homography follows a part of this displacement, so the residuals do not show that part. If the
/// mean residuals of the bands of rows vary by more than the noise explains, each band adds this
/// excess variance to the covariance.
void PictureAligner::addVibration(UncertainHomography& estimate) {
  constexpr double kFitted = 3.0;  // a homography can fit the shifts of this many bands
  // Neighbouring patches overlap by half in x and y, so the noise variance of a band's mean
  // residual is this many times as large as with independent patches.
  constexpr double kOverlap = 4.0;
  const Eigen::Vector2d squares = sumBands(estimate.homography);
  double count = 0.0;
  Eigen::Vector2d between = Eigen::Vector2d::Zero();
  for (const Band& band : bands_) {
    count += band.count;
    between += band.error.cwiseAbs2() / band.count;
  }
  const auto bands = static_cast<double>(bands_.size());
  if (!(count > bands)) return;
  const Eigen::Vector2d noise = (squares - between) / (count - bands);
  const Eigen::Vector2d excess = (between - kOverlap * bands * noise).cwiseMax(0.0);
  const Eigen::Vector2d variance = bands / std::max(1.0, bands - kFitted) / count * excess;
  if (variance.isZero(0.0)) return;
  Eigen::Matrix<double, 8, 8> spread = Eigen::Matrix<double, 8, 8>::Zero();
  Eigen::Matrix<double, 8, 8> information = Eigen::Matrix<double, 8, 8>::Zero();
  for (const Band& band : bands_) {
    spread += band.slope.transpose() * variance.asDiagonal() * band.slope;
    information += band.information;
  }
  const Covariance8 unseen = estimation::sandwich(estimation::inverseOf(information), spread);
  if (!unseen.allFinite()) return;
  estimate.covariance += unseen;
  estimate.shared_covariance += unseen;
}

/// Fits the homography to the patches aligned by the last call of alignNear().
bool PictureAligner::refine(UncertainHomography& estimate) {
  constexpr double kMaxError = 3.0;  // px
  return refiner_.refine(reference_, target_, size_,
                         homography::evidenceOfPatches(kMaxError, size_), estimate);
}

}  // namespace ktgp_orb::targets
