#include "ktgp_orb/alignment.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "features/alignment/patch_aligner.h"
#include "features/alignment/spread.h"
#include "homography/fit.h"
#include "homography/part_in_view.h"
#include "util/keypoint_position.h"
#include "util/names.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

using alignment::bestAlignmentKernels;

constexpr std::size_t kFewest = 12;  // minimum number of aligned points for an estimate
constexpr double kReach = 4.0;       // px; a patch may be at most this far from where H predicts it

/// The counter in AlignmentResult for each PatchOutcome, in the order of the enumerators. Aligned
/// points have no counter, because they are in `points`.
constexpr std::size_t AlignmentResult::*kCounts[] = {nullptr,
                                                     &AlignmentResult::outside,
                                                     &AlignmentResult::distorted,
                                                     &AlignmentResult::textureless,
                                                     &AlignmentResult::unsettled,
                                                     &AlignmentResult::beyond_reach,
                                                     &AlignmentResult::uncorrelated};

double rmse(const Eigen::Matrix3d& homography, const std::vector<AlignedPoint>& points) {
  double sum = 0.0;
  for (const AlignedPoint& p : points) {
    const double error = homography::errorOf(homography, p.reference, p.target);
    sum += error * error;
  }
  return points.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(points.size()));
}

/// Returns the uncertainty of the homography, px: the largest standard deviation at the image
/// corners. Computes it for the corners of the reference mapped to the target, and for these points
/// mapped back to the reference, and returns the smaller result.
double uncertainty(const Eigen::Matrix3d& homography, const Covariance8& covariance,
                   const cv::Size& reference_size) {
  const auto corners = homography::imageCorners(reference_size, {});
  const homography::CornerDeviation deviation =
      homography::cornerDeviation(homography, covariance, corners);
  return std::min(deviation.target, deviation.reference);
}

/// Returns true if the aligned homography `candidate` should replace `before`, the homography from
/// keypoints: its uncertainty at the image corners must not be larger. It is larger if patches
/// could be aligned only in a small part of the image, or if their positions are as noisy as
/// keypoints. The shared covariance of the candidate is left out, because it describes smooth
/// errors that come from the scene, and keypoints have the same errors.
bool isBetter(const UncertainHomography& candidate, const UncertainHomography& before,
              const cv::Size& reference_size) {
  return uncertainty(candidate.homography, candidate.covariance - candidate.shared_covariance,
                     reference_size) <=
         uncertainty(before.homography, before.covariance, reference_size);
}

}  // namespace

const char* toString(AlignmentStatus status) {
  return util::nameOf<AlignmentStatus::not_better>(
      status, {"not_run", "ok", "no_images", "too_few_points", "not_better"});
}

struct Alignment::Impl {
  Impl(const AlignmentOptions& o, double error)
      : aligner(bestAlignmentKernels()), options(o), max_error(error) {}

  void choosePoints(const Features& reference, const Features& target,
                    const std::vector<Correspondence>& matches);
  void alignPoints(const std::vector<Correspondence>& matches, AlignmentResult& result);
  void estimate(const cv::Size& reference_size, AlignmentResult& result);

  alignment::PatchAligner aligner;
  homography::HomographyRefiner refiner;
  double rounding2 = 0.0;  // sum of AlignedPatch::rounding2 over the aligned patches, px²
  // Positions of the reference keypoints of all matches.
  std::vector<Eigen::Vector2d> reference_points;
  std::vector<Eigen::Vector2d> target_points;
  std::vector<std::uint32_t> chosen;
  std::vector<Eigen::Vector2d> aligned_reference;
  std::vector<Eigen::Vector2d> aligned_target;
  alignment::PointSpread spread;
  AlignmentOptions options;
  double max_error;  // px
};

Alignment::Alignment(const AlignmentOptions& options, double max_error) {
  util::requireInRange("alignment max_error", max_error, 1e-6, 1e6);
  util::requireInRange("alignment_points", options.points, static_cast<int>(kFewest), 100000);
  impl_ = std::make_unique<Impl>(options, max_error);
}

Alignment::~Alignment() = default;
Alignment::Alignment(Alignment&&) noexcept = default;
Alignment& Alignment::operator=(Alignment&&) noexcept = default;

const AlignmentOptions& Alignment::options() const {
  return impl_->options;
}

void Alignment::align(const Features& reference, const Features& target,
                      const std::vector<Correspondence>& matches, const UncertainHomography& start,
                      AlignmentResult& result) {
  result.points.clear();
  // Moving `points` into the new result keeps the buffer.
  result = {AlignmentStatus::not_run, start, std::move(result.points)};
  Impl& impl = *impl_;
  if (!impl.options.enabled) return;
  if (!impl.aligner.setImages(reference.images, target.images)) {
    result.status = AlignmentStatus::no_images;
    return;
  }
  impl.choosePoints(reference, target, matches);
  impl.alignPoints(matches, result);
  impl.estimate(reference.image_size, result);
}

void Alignment::Impl::choosePoints(const Features& reference, const Features& target,
                                   const std::vector<Correspondence>& matches) {
  reference_points.clear();
  target_points.clear();
  for (const Correspondence& match : matches) {
    util::requireKeypoint(reference, match.reference_index, "reference");
    util::requireKeypoint(target, match.target_index, "target");
    reference_points.push_back(util::position(reference, match.reference_index));
    target_points.push_back(util::position(target, match.target_index));
  }
  spread.choose(reference_points, reference.image_size, static_cast<std::size_t>(options.points),
                chosen);
}

void Alignment::Impl::alignPoints(const std::vector<Correspondence>& matches,
                                  AlignmentResult& result) {
  aligned_reference.clear();
  aligned_target.clear();
  rounding2 = 0.0;
  result.tried = chosen.size();
  const Eigen::Matrix3d view = homography::facing(result.answer.homography);
  for (const std::uint32_t match : chosen) {
    const alignment::AlignedPatch patch = aligner.align(view, reference_points[match], kReach);
    if (patch.outcome != alignment::PatchOutcome::aligned) {
      ++(result.*kCounts[static_cast<std::size_t>(patch.outcome)]);
      continue;
    }
    result.points.push_back({match, matches[match].reference_index, matches[match].target_index,
                             patch.reference, patch.target, patch.correlation});
    aligned_reference.push_back(patch.reference);
    aligned_target.push_back(patch.target);
    rounding2 += patch.rounding2;
  }
}

void Alignment::Impl::estimate(const cv::Size& reference_size, AlignmentResult& result) {
  result.rmse_before = result.rmse_after = rmse(result.answer.homography, result.points);
  result.status = AlignmentStatus::too_few_points;
  if (result.points.size() < kFewest) return;
  auto evidence = homography::evidenceOfPatches(max_error, reference_size);
  evidence.rounding = std::sqrt(rounding2 / static_cast<double>(result.points.size()));
  UncertainHomography candidate = result.answer;
  result.status = AlignmentStatus::not_better;
  if (!refiner.refine(aligned_reference, aligned_target, reference_size, evidence, candidate) ||
      !isBetter(candidate, result.answer, reference_size)) {
    return;
  }
  result.answer = candidate;
  result.rmse_after = rmse(candidate.homography, result.points);
  result.status = AlignmentStatus::ok;
}

}  // namespace ktgp_orb
