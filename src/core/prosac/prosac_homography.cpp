#include "ktgp_orb/prosac_homography.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "core/homography/checks.h"
#include "core/homography/refinement.h"
#include "core/homography/score.h"
#include "core/prosac/points.h"
#include "core/prosac/search.h"
#include "core/prosac/verdict.h"
#include "core/util/options_check.h"

namespace ktgp_orb {
namespace {

using Matrix8 = Eigen::Matrix<double, 8, 8>;
constexpr std::size_t kSampleSize = 4;

void requireValid(const PointPairs& pairs) {
  const std::size_t n = pairs.reference.size();
  if (pairs.target.size() != n || pairs.quality.size() != n) {
    throw std::invalid_argument("point pairs have " + std::to_string(n) + " reference points, " +
                                std::to_string(pairs.target.size()) + " target points and " +
                                std::to_string(pairs.quality.size()) +
                                " qualities; expected three equal numbers");
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (pairs.reference[i].allFinite() && pairs.target[i].allFinite() &&
        std::isfinite(pairs.quality[i])) {
      continue;
    }
    throw std::invalid_argument("point pair " + std::to_string(i) +
                                " is not finite; expected finite coordinates and quality");
  }
}

/// Chance that a pair agrees with a wrong model: a random target point within the threshold. Never
/// taken below 1 %, as keypoints are not spread evenly.
double chanceInlier(const PointPairs& pairs, double threshold) {
  constexpr double kLeast = 0.01;
  constexpr double kMost = 0.5;
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : pairs.target) box.extend(p);
  const double disc = 3.14159265358979323846 * threshold * threshold;
  return std::clamp(disc / std::max(box.volume(), disc), kLeast, kMost);
}

/// The homography between normalised coordinates, with the third coordinate positive at the centre
/// of the reference points; none where it is no view of a plane from one side.
std::optional<Eigen::Matrix3d> normalised(const Eigen::Matrix3d& pixel,
                                          const ProsacPoints& points) {
  constexpr double kSingular = 1e-12;  // the determinant, of entries of the order of 1
  Eigen::Matrix3d h = points.target.matrix() * pixel * points.reference.inverse();
  h /= h(2, 2);
  if (!h.allFinite() || !(h.determinant() > kSingular)) return std::nullopt;
  return h;
}

void clearModel(ProsacResult& result) {
  result.homography.setZero();
  std::fill(result.mask.begin(), result.mask.end(), std::uint8_t{0});
  result.inliers = 0;
  result.rmse = 0.0;
}

void reset(std::size_t pairs, ProsacResult& result) {
  std::vector<std::uint8_t> mask = std::move(result.mask);  // keep the buffer
  mask.assign(pairs, 0);
  result = {};
  result.mask = std::move(mask);
}

}  // namespace

/// What one call of estimate() works on; kept for its buffers.
struct ProsacHomography::Workspace {
  ProsacPoints points;
  ProsacSearch search;
  HomographyRefinement refinement;
  std::vector<std::uint8_t> inlier;   // by quality: pairs that the refinement may use
  std::vector<std::uint8_t> refined;  // by quality: pairs that it used last
  std::vector<double> squared_error;  // of the final homography, px², in input order
  ProsacVerdict verdict;
};

ProsacHomography::ProsacHomography(const ProsacOptions& options)
    : options_(options), workspace_(std::make_unique<Workspace>()) {
  requireInRange("prosac threshold", options.threshold, 1e-6, 1e6);
  requireInRange("max_iterations", options.max_iterations, 1, 1000000);
  requireInRange("confidence", options.confidence, 1e-6, 1.0 - 1e-9);
}

ProsacHomography::~ProsacHomography() = default;
ProsacHomography::ProsacHomography(ProsacHomography&&) noexcept = default;
ProsacHomography& ProsacHomography::operator=(ProsacHomography&&) noexcept = default;

void ProsacHomography::estimate(const PointPairs& pairs, const cv::Size& reference_size,
                                ProsacResult& result) {
  estimate(pairs, reference_size, std::nullopt, result);
}

void ProsacHomography::estimate(const PointPairs& pairs, const cv::Size& reference_size,
                                const std::optional<Eigen::Matrix3d>& initial,
                                ProsacResult& result) {
  requireValid(pairs);
  if (initial && !initial->allFinite()) {
    throw std::invalid_argument("the initial homography has an entry that is not finite");
  }
  reset(pairs.size(), result);
  if (pairs.size() < kSampleSize) {
    result.status = Status::too_few_matches;
    return;
  }
  Workspace& work = *workspace_;
  work.points.load(pairs, options_.threshold);
  const double chance = chanceInlier(pairs, options_.threshold);
  const auto start = initial ? normalised(*initial, work.points) : std::nullopt;
  if (!work.search.run(work.points, options_, chance, start, result)) return;  // no_model
  Eigen::Matrix3d h = work.search.best();
  bool supported = false;
  if (refine(h, supported)) {
    judge(pairs, reference_size, h, result);
  } else if (supported) {
    result.status = Status::model_rejected;
  }
}

namespace {

/// Scales H to H(2,2) = 1, to length 1 where that is not possible; false in that case.
bool scaleLastToOne(Eigen::Matrix3d& h) {
  constexpr double kNearZero = 1e-9;  // of H's length
  const bool possible = std::abs(h(2, 2)) > kNearZero * h.norm();
  h /= possible ? h(2, 2) : h.norm();
  return possible;
}

/// Squared reprojection errors, mask, inliers and RMSE of the homography, in pixels.
void applyThreshold(const PointPairs& pairs, double threshold, std::vector<double>& squared_error,
                    ProsacResult& result) {
  squared_error.resize(pairs.size());
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = reprojectionError(result.homography, pairs.reference[i], pairs.target[i]);
    squared_error[i] = error * error;
    result.mask[i] = error < threshold ? 1 : 0;
    if (result.mask[i] == 0) continue;
    ++result.inliers;
    sum += squared_error[i];
  }
  result.rmse = result.inliers > 0 ? std::sqrt(sum / static_cast<double>(result.inliers)) : 0.0;
}

/// Covariance of the pixel homography's entries from that of the normalised one's, by the chain
/// rule through T_target^-1 H T_reference and the division by the last entry.
Matrix8 pixelCovariance(const Matrix8& covariance, const ProsacPoints& points,
                        const Eigen::Matrix3d& h) {
  const Eigen::Matrix3d undivided = points.target.inverse() * h * points.reference.matrix();
  const double divisor = undivided(2, 2);
  const Eigen::Matrix3d pixel = undivided / divisor;
  Matrix8 jacobian;
  for (int j = 0; j < 8; ++j) {
    Eigen::Matrix3d unit = Eigen::Matrix3d::Zero();
    unit(j / 3, j % 3) = 1.0;
    const Eigen::Matrix3d column = points.target.inverse() * unit * points.reference.matrix();
    for (int i = 0; i < 8; ++i) {
      jacobian(i, j) = (column(i / 3, i % 3) - pixel(i / 3, i % 3) * column(2, 2)) / divisor;
    }
  }
  return jacobian * covariance * jacobian.transpose();
}

}  // namespace

/// Refines the best homography over the pairs within reach until these stay the same. False where
/// they do not determine it; `supported` says whether there were more of them than a sample has.
bool ProsacHomography::refine(Eigen::Matrix3d& h, bool& supported) {
  // The weights tell good pairs from bad ones better than the threshold does, so the refinement
  // sees the pairs just beyond it as well.
  constexpr double kReach = 2.0;  // thresholds
  constexpr int kMaxRounds = 10;
  constexpr double kMinScale = 1e-4;  // px
  Workspace& work = *workspace_;
  const ProsacPoints& points = work.points;
  double scale = points.limit / kReach;
  for (int round = 0; round < kMaxRounds; ++round) {
    const std::size_t near = findInliers(points.scoring, h, kReach * points.limit, work.inlier);
    supported = near > kSampleSize;
    if (!supported) return false;
    if (round > 0 && work.inlier == work.refined) return true;
    std::swap(work.inlier, work.refined);
    work.refinement.select(points.refinement, work.refined, near);
    if (!work.refinement.minimise(kMinScale * points.target.scale, scale, h)) return false;
  }
  return true;
}

/// True where the pairs of the refinement say where the image goes, and still do without any
/// quarter of them: with all of them but one on a line, everything hangs on that one.
/// Deviations count in the image where they are smaller: a strong perspective magnifies a corner
/// that it moves far out of sight, and the error of it likewise.
bool ProsacHomography::isDetermined(const Eigen::Matrix3d& h,
                                    const std::array<Eigen::Vector2d, 4>& corners) const {
  constexpr double kMaxDeviation = 10.0;         // px at the worst corner
  constexpr double kMaxDeviationWithout = 20.0;  // px, with fewer pairs
  constexpr std::size_t kEnough = 100;           // pairs; more would be determined even better
  const HomographyRefinement& refinement = workspace_->refinement;
  const ProsacPoints& points = workspace_->points;
  const auto deviation = [&](const Matrix8& covariance) {
    const CornerDeviation normalised = cornerDeviation(h, covariance, corners);
    return std::min(normalised.target / points.target.scale,
                    normalised.reference / points.reference.scale);
  };
  if (!(deviation(refinement.covariance()) < kMaxDeviation)) return false;
  const std::size_t all = refinement.size();
  const std::size_t folds = all <= 8 ? all : 4;
  const auto holds_with = [&](std::size_t count) {
    for (std::size_t fold = 0; fold < folds; ++fold) {
      const Matrix8 without = refinement.covarianceWithout(h, count, fold, folds);
      if (!(deviation(without) < kMaxDeviationWithout)) return false;
    }
    return true;
  };
  return holds_with(std::min(all, kEnough)) || (all > kEnough && holds_with(all));
}

/// Verdict on the normalised homography; fills in what the verdict allows.
void ProsacHomography::judge(const PointPairs& pairs, const cv::Size& reference_size,
                             const Eigen::Matrix3d& h, ProsacResult& result) {
  Workspace& work = *workspace_;
  const ProsacPoints& points = work.points;
  result.status = Status::model_rejected;
  auto corners = imageCorners(reference_size, pairs.reference);
  Eigen::Matrix3d pixel = points.target.inverse() * h * points.reference.matrix();
  if (!keepsPlaneInView(pixel, corners)) return;
  for (Eigen::Vector2d& corner : corners) corner = points.reference.apply(corner);
  if (!isDetermined(h, corners)) return;

  const bool scaled = scaleLastToOne(pixel);
  result.homography = pixel;
  applyThreshold(pairs, options_.threshold, work.squared_error, result);
  if (work.verdict.explainableByChance(pairs, result.mask, work.squared_error,
                                       options_.threshold)) {
    clearModel(result);
    return;
  }
  result.distinct_inliers = work.verdict.distinctInliers(pairs, result.mask);
  if (scaled) {
    result.covariance = pixelCovariance(work.refinement.covariance(), points, h);
  } else {
    result.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  result.status = Status::ok;
}

}  // namespace ktgp_orb
