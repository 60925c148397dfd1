#include "core/homography/estimate.h"

#include <Eigen/Geometry>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>

#include "core/homography/transform.h"

namespace ktgp_orb::homography {
namespace {

/// The pairs in the order of the input.
struct InputOrder {
  std::size_t operator[](std::size_t place) const { return place; }
};

}  // namespace

// Both limits were chosen for PROSAC's threshold of 3 px and images of 640x480.
EvidenceOptions evidenceOfPatches(double max_error, const cv::Size& reference_size) {
  constexpr double kFoundWithError = 3.0;       // px
  constexpr double kFoundWithDiagonal = 800.0;  // px
  constexpr double kScale = 1.0;  // px: every scene deviates from a plane by this much
  const double diagonal = std::hypot(reference_size.width, reference_size.height);
  const double size = diagonal / kFoundWithDiagonal;
  return {max_error * size, kScale * max_error / kFoundWithError * size, {true, 0.0}};
}

bool HomographyRefiner::refine(const std::vector<Eigen::Vector2d>& reference,
                               const std::vector<Eigen::Vector2d>& target,
                               const cv::Size& reference_size, const EvidenceOptions& options,
                               UncertainHomography& estimate) {
  if (reference.size() != target.size()) {
    throw std::invalid_argument("there are " + std::to_string(reference.size()) +
                                " reference points and " + std::to_string(target.size()) +
                                " target points; expected equal numbers");
  }
  if (reference.empty()) return false;
  pairs_.load(reference, target, InputOrder(), options.max_error);
  constexpr double kCells = 16.0;  // along the diagonal, as in SmoothField
  const auto corners = imageCorners(reference_size, reference);
  const double cell = options.by_cell ? (corners[2] - corners[0]).norm() / kCells : 0.0;
  std::optional<Eigen::Matrix3d> h = pairs_.fromPixels(estimate.homography);
  if (!h || fit_.fit(pairs_, options.min_scale, cell, *h) != FitOutcome::fitted) return false;
  const UncertainHomography refined = fit_.inPixels(pairs_, *h, corners, options.errors);
  if (!refined.homography.allFinite()) return false;
  estimate = refined;
  return true;
}

void Finaliser::finalise(const UncertainHomography& estimate, const PointPairs& pairs,
                         const cv::Size& reference_size, double max_error,
                         FinalHomography& result) {
  result.mask.resize(pairs.size());
  squared_error_.resize(pairs.size());
  result.inliers = 0;
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = errorOf(estimate.homography, pairs.reference[i], pairs.target[i]);
    squared_error_[i] = error * error;
    result.mask[i] = error < max_error * pairs.noiseOf(i) ? 1 : 0;
    if (result.mask[i] == 0) continue;
    ++result.inliers;
    sum += squared_error_[i];
  }
  result.rmse = result.inliers > 0 ? std::sqrt(sum / static_cast<double>(result.inliers)) : 0.0;
  const auto corners = imageCorners(reference_size, pairs.reference);
  // When the origin is far from all points, H(2,2) = 1 may change the sign of the third coordinate.
  const double sign = estimate.homography.row(2).dot(corners[0].homogeneous()) < 0.0 ? -1.0 : 1.0;
  result.trusted = keepsPlaneInView(sign * estimate.homography, corners) &&
                   !contrario_.explainableByChance(pairs, result.mask, squared_error_, max_error,
                                                   coveredArea(pairs.target));
}

}  // namespace ktgp_orb::homography
