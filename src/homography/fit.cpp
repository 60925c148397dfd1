#include "homography/fit.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "util/keypoint_position.h"

namespace ktgp_orb::homography {

using Matrix8 = HomographyFit::Matrix8;
using FloatPoints = PointArrays<float>;

namespace {

/// Squared reprojection errors of eight pairs. Points on or beyond the horizon get a huge error.
FloatPoints::Lanes squaredErrors(const FloatPoints& points, const Eigen::Matrix3f& h,
                                 std::size_t first) {
  using Lanes = FloatPoints::Lanes;
  constexpr float kHorizon = 1e-6F;
  const Lanes x = FloatPoints::load(points.x, first);
  const Lanes y = FloatPoints::load(points.y, first);
  const Lanes w = (h(2, 0) * x + h(2, 1) * y + h(2, 2)).max(kHorizon);
  const Lanes du = h(0, 0) * x + h(0, 1) * y + h(0, 2) - FloatPoints::load(points.u, first) * w;
  const Lanes dv = h(1, 0) * x + h(1, 1) * y + h(1, 2) - FloatPoints::load(points.v, first) * w;
  return (du * du + dv * dv) / (w * w);
}

double diagonalOf(const FourPoints& corners) {
  return (corners[2] - corners[0]).norm();
}

}  // namespace

float msacCost(const FloatPoints& points, const Eigen::Matrix3d& homography, double limit,
               float give_up) {
  // After every block of this many pairs, we check whether the sum exceeds `give_up`.
  constexpr std::size_t kBlock = 8 * FloatPoints::kLanes;
  const Eigen::Matrix3f h = homography.cast<float>();
  const float limit2 = static_cast<float>(limit * limit);
  const std::size_t padding = points.paddedSize() - points.size;
  float cost = -limit2 * static_cast<float>(padding);
  for (std::size_t start = 0; start < points.paddedSize(); start += kBlock) {
    FloatPoints::Lanes sum = FloatPoints::Lanes::Zero();
    const std::size_t end = std::min(start + kBlock, points.paddedSize());
    for (std::size_t i = start; i < end; i += FloatPoints::kLanes) {
      sum += squaredErrors(points, h, i).min(limit2);
    }
    cost += sum.sum();
    if (cost > give_up) break;
  }
  return cost;
}

std::size_t findInliers(const FloatPoints& points, const Eigen::Matrix3d& homography, double limit,
                        std::vector<std::uint8_t>& inlier) {
  const Eigen::Matrix3f h = homography.cast<float>();
  return points.markNear(
      limit, [&](std::size_t first) { return squaredErrors(points, h, first); }, inlier);
}

bool HomographyProblem::solve(const estimation::ProsacSample& sample,
                              Eigen::Matrix3d& homography) const {
  const PointArrays<double>& p = pairs_->refinement;
  FourPoints from;
  FourPoints to;
  for (std::size_t i = 0; i < kSample; ++i) {
    from[i] = {p.x[sample[i]], p.y[sample[i]]};
    to[i] = {p.u[sample[i]], p.v[sample[i]]};
  }
  return solveFourPoints(from, to, pairs_->min_reference_area, pairs_->min_target_area, homography);
}

bool HomographyProblem::refine(double widening, Eigen::Matrix3d& homography) {
  // Only this many of the best pairs are used; more pairs do not improve the homography.
  constexpr std::size_t kEnough = 200;
  constexpr double kScales = 3.0;  // assumed ratio of `limit` to the scale of the errors
  const double limit = widening * pairs_->limit;
  homography::findInliers(pairs_->scoring, homography, limit, near_);
  if (estimator_.select(pairs_->refinement, near_, kEnough) <= kSample) return false;
  return estimator_.step(limit / kScales, homography);
}

Status HomographyFit::fit(const NormalisedPairs& pairs, const FourPoints& corners,
                          const EvidenceOptions& options, Eigen::Matrix3d& homography) {
  // The refinement also uses pairs just beyond the threshold, because the weights separate good
  // pairs from bad ones better than the threshold does.
  constexpr double kReach = 2.0;  // multiple of the inlier threshold
  constexpr int kMaxRounds = 10;
  const double least = options.min_scale * pairs.target.scale;
  const double cell = diagonalOf(corners) / kCellsAlongDiagonal;  // px
  double scale = std::max(pairs.limit / kReach, least);
  for (int round = 0; round < kMaxRounds; ++round) {
    const std::size_t near = findInliers(pairs.scoring, homography, kReach * pairs.limit, near_);
    if (near <= HomographyProblem::kSample) return Status::no_model;
    if (round > 0 && near_ == used_) break;
    std::swap(near_, used_);
    estimator_.select(pairs.refinement, used_, near);
    if (options.by_cell && cell > 0.0) estimator_.weighByCell(cell * pairs.reference.scale);
    if (!estimator_.minimise(least, scale, homography)) return Status::model_rejected;
  }
  return Status::ok;
}

/// Tests whether all pairs determine H, and whether H is still determined without some of them: if
/// all pairs but one lie on a line, for example, H depends on this one pair. We compute the
/// standard deviation of a corner in both images and use the smaller one, because a strong
/// perspective that moves a corner far away in one image also magnifies the error there.
bool HomographyFit::isDetermined(const NormalisedPairs& pairs, const FourPoints& corners,
                                 const Eigen::Matrix3d& homography) const {
  // Upper limits of the standard deviation at the worst corner, px: with all pairs, and if some
  // pairs are left out.
  constexpr double kMaxDeviation = 10.0;
  constexpr double kMaxDeviationWithout = 20.0;
  // Number of pairs to test first. If these pairs determine H, so do all pairs.
  constexpr std::size_t kEnough = 100;
  FourPoints normalised_corners;
  for (std::size_t i = 0; i < 4; ++i) normalised_corners[i] = pairs.reference.apply(corners[i]);
  const auto deviation = [&](const Matrix8& covariance) {
    const CornerDeviation normalised = cornerDeviation(homography, covariance, normalised_corners);
    return std::min(normalised.target / pairs.target.scale,
                    normalised.reference / pairs.reference.scale);
  };
  if (!(deviation(estimator_.covariance()) < kMaxDeviation)) return false;
  const std::size_t all = estimator_.size();
  const std::size_t folds = all <= 8 ? all : 4;
  const auto holds_with = [&](std::size_t count) {
    for (std::size_t fold = 0; fold < folds; ++fold) {
      const Matrix8 without = estimator_.covarianceWithout(homography, count, fold, folds);
      if (!(deviation(without) < kMaxDeviationWithout)) return false;
    }
    return true;
  };
  return holds_with(std::min(all, kEnough)) || (all > kEnough && holds_with(all));
}

namespace {

/// Jacobian of the eight entries of H in pixels, with H(2,2) = 1, with respect to the entries of
/// the normalised H. Uses the chain rule for the conversion to pixels (toPixels()) and for the
/// division by the last entry.
HomographyFit::Matrix8 jacobianOfPixels(const NormalisedPairs& pairs,
                                        const Eigen::Matrix3d& homography) {
  const Eigen::Matrix3d undivided = pairs.toPixels(homography);
  const double divisor = undivided(2, 2);
  const Eigen::Matrix3d pixel = undivided / divisor;
  HomographyFit::Matrix8 jacobian;
  for (int j = 0; j < 8; ++j) {
    Eigen::Matrix3d unit = Eigen::Matrix3d::Zero();
    unit(j / 3, j % 3) = 1.0;
    const Eigen::Matrix3d column = pairs.toPixels(unit);
    for (int i = 0; i < 8; ++i) {
      jacobian(i, j) = (column(i / 3, i % 3) - pixel(i / 3, i % 3) * column(2, 2)) / divisor;
    }
  }
  return jacobian;
}

/// Distance in the reference, px, over which the displacement between the images changes by a
/// pixel. It is computed at the middle of the points, and is infinite if all points have the same
/// displacement.
double lengthOfAPixel(const NormalisedPairs& pairs, const Eigen::Matrix3d& homography) {
  const Eigen::Matrix2d slope =
      homography.topLeftCorner<2, 2>() -
      homography.topRightCorner<2, 1>() * homography.bottomLeftCorner<1, 2>();
  const double zoom = pairs.reference.scale / pairs.target.scale;
  const double change = (zoom * slope - Eigen::Matrix2d::Identity()).norm() / std::sqrt(2.0);
  return 1.0 / change;
}

}  // namespace

UncertainHomography HomographyFit::inPixels(const NormalisedPairs& pairs, const FourPoints& corners,
                                            const EvidenceOptions& options,
                                            const Eigen::Matrix3d& homography) {
  constexpr double kNearby = 16.0;  // px, the side of the patches that alignment uses
  // Minimum significance of a smooth field (see FieldScales). If we assume a field although none
  // exists, the covariance becomes too large: much too large for keypoints, whose noise is large,
  // and slightly too large for aligned points. So for keypoints the minimum is higher.
  constexpr double kSignificantOfPatches = 1.0;
  constexpr double kSignificantOfKeypoints = 2.5;
  FieldScales scales;
  const bool of_patches = options.of_patches;
  scales.significance = of_patches ? kSignificantOfPatches : kSignificantOfKeypoints;
  scales.image_diagonal = diagonalOf(corners) * pairs.reference.scale;
  scales.nearby = kNearby * pairs.reference.scale;
  scales.rounding_length = pairs.reference.scale * lengthOfAPixel(pairs, homography);
  const FieldFit field = field_.fit(estimator_.pairs(), estimator_.weights(),
                                    estimator_.curvature(), homography, scales);
  // The scale of the errors is estimated with f (`freedom`) degrees of freedom, so H has Student's
  // t distribution. Its covariance is f / (f - 2) times the covariance for a known scale.
  const double freedom = estimator_.freedom();
  const double spread = freedom / std::max(freedom - 2.0, 1.0);
  const double shared = of_patches ? field.shared_patches : 1.0;
  Matrix8 noise = spread * field.noise_share * shared * estimator_.covariance();
  if (of_patches) noise += field.common_covariance;
  const double rounding = options.rounding * pairs.target.scale;
  // Rounding errors of variance rounding² may be similar for neighbouring pairs. If the grey values
  // are noisy, however, their rounding differs from patch to patch and is already part of the
  // measured noise (`seen`). So only the rest of the variance (`unseen`) is added here.
  const double seen = of_patches ? field.noise_variance : 0.0;
  const double unseen = std::max(rounding * rounding - seen, 0.0);
  const Matrix8 smooth = field.covariance + unseen * field.of_rounding;
  const Matrix8 jacobian = jacobianOfPixels(pairs, homography);
  UncertainHomography result;
  result.homography = pairs.toPixels(homography);
  scaleLastToOne(result.homography);
  result.shared_covariance = jacobian * smooth * jacobian.transpose();
  result.covariance = jacobian * noise * jacobian.transpose() + result.shared_covariance;
  result.plane_deviation = std::sqrt(field.variance) / pairs.target.scale;
  return result;
}

EvidenceOptions evidenceOfKeypoints(double max_error, bool by_cell) {
  EvidenceOptions evidence;
  evidence.max_error = max_error;
  evidence.rounding = util::kKeypointRounding;
  evidence.by_cell = by_cell;
  return evidence;
}

// The inlier threshold and the lower limit of the error scale (kScale) were chosen for PROSAC's
// threshold of 3 px and images of 640x480 px. Both are scaled to the threshold and the image size
// given here.
EvidenceOptions evidenceOfPatches(double max_error, const cv::Size& reference_size) {
  constexpr double kFoundWithError = 3.0;       // px
  constexpr double kFoundWithDiagonal = 800.0;  // px
  constexpr double kScale = 1.0;  // px: every scene deviates from a plane by about this much
  const double diagonal = std::hypot(reference_size.width, reference_size.height);
  const double size = diagonal / kFoundWithDiagonal;
  return {max_error * size, kScale * max_error / kFoundWithError * size, true};
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
  const auto in_order_of_input = [](std::size_t place) { return place; };
  pairs_.load(reference, target, in_order_of_input, options.max_error);
  const FourPoints corners = imageCorners(reference_size, reference);
  std::optional<Eigen::Matrix3d> h = pairs_.fromPixels(estimate.homography);
  if (!h || fit_.fit(pairs_, corners, options, *h) != Status::ok) return false;
  const UncertainHomography refined = fit_.inPixels(pairs_, corners, options, *h);
  if (!refined.homography.allFinite()) return false;
  estimate = refined;
  return true;
}

}  // namespace ktgp_orb::homography
