#include "ktgp_orb/prosac_homography.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "core/homography/checks.h"
#include "core/homography/estimator.h"
#include "core/homography/fit.h"
#include "core/homography/verdict.h"
#include "core/prosac/prosac.h"
#include "core/prosac/quality_order.h"
#include "core/util/options_check.h"

namespace ktgp_orb {
namespace {

using util::requireInRange;

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

void requireValid(const std::optional<Eigen::Matrix3d>& initial) {
  if (!initial || initial->allFinite()) return;
  throw std::invalid_argument(
      "the initial homography has an entry that is not finite; expected nine finite entries");
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

void store(const ProsacRun& run, ProsacResult& result) {
  result.iterations = run.iterations;
  result.local_optimisations = run.local_optimisations;
  result.growth_set_size = run.growth_set_size;
  result.stop = run.exhausted ? ProsacStop::max_iterations : ProsacStop::maximality;
}

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

}  // namespace

/// Search, fit and verdict, with their buffers.
struct ProsacHomography::Impl {
  ProsacOptions options;
  QualityOrder order;
  HomographyEstimator estimator;
  Prosac<HomographyEstimator> search;
  HomographyFit fit;
  HomographyVerdict verdict;
  double covered_area = 0.0;          // of the target points, px²
  std::vector<double> squared_error;  // of the final homography, px², in input order

  void estimate(const PointPairs& pairs, const cv::Size& reference_size,
                const std::optional<Eigen::Matrix3d>& initial, ProsacResult& result);
  bool find(const PointPairs& pairs, const std::optional<Eigen::Matrix3d>& initial,
            ProsacResult& result);
  void judge(const PointPairs& pairs, const cv::Size& reference_size, const Eigen::Matrix3d& h,
             ProsacResult& result);
};

void ProsacHomography::Impl::estimate(const PointPairs& pairs, const cv::Size& reference_size,
                                      const std::optional<Eigen::Matrix3d>& initial,
                                      ProsacResult& result) {
  constexpr double kMinScale = 1e-4;  // px
  requireValid(pairs);
  requireValid(initial);
  reset(pairs.size(), result);
  if (pairs.size() < HomographyEstimator::kSampleSize) {
    result.status = Status::too_few_matches;
    return;
  }
  if (!find(pairs, initial, result)) return;  // no_model
  Eigen::Matrix3d h = search.best();
  switch (fit.fit(estimator.problem, kMinScale, h)) {
    case FitOutcome::fitted:
      judge(pairs, reference_size, h, result);
      break;
    case FitOutcome::undetermined:
      result.status = Status::model_rejected;
      break;
    case FitOutcome::unsupported:
      break;  // no_model
  }
}

/// The search; false where no sample gave a homography.
bool ProsacHomography::Impl::find(const PointPairs& pairs,
                                  const std::optional<Eigen::Matrix3d>& initial,
                                  ProsacResult& result) {
  order.sort(pairs.quality);
  estimator.problem.load(pairs.reference, pairs.target, order, options.max_error);
  ProsacRules rules;
  rules.max_iterations = options.max_iterations;
  rules.confidence = options.confidence;
  covered_area = coveredArea(pairs.target);
  rules.chance_inlier = chanceInlier(covered_area, options.max_error);
  rules.seed = options.seed;
  const auto start = initial ? estimator.problem.fromPixels(*initial) : std::nullopt;
  const ProsacRun run = search.run(rules, start ? &*start : nullptr, estimator);
  store(run, result);
  return run.found;
}

/// Verdict on the normalised homography; fills in what the verdict allows.
void ProsacHomography::Impl::judge(const PointPairs& pairs, const cv::Size& reference_size,
                                   const Eigen::Matrix3d& h, ProsacResult& result) {
  const HomographyProblem& problem = estimator.problem;
  result.status = Status::model_rejected;
  auto corners = imageCorners(reference_size, pairs.reference);
  Eigen::Matrix3d pixel = problem.toPixels(h);
  if (!keepsPlaneInView(pixel, corners)) return;
  for (Eigen::Vector2d& corner : corners) corner = problem.reference.apply(corner);
  if (!fit.isDetermined(problem, h, corners)) return;

  const bool scaled = scaleLastToOne(pixel);
  result.homography = pixel;
  applyThreshold(pairs, options.max_error, squared_error, result);
  if (verdict.explainableByChance(pairs, result.mask, squared_error, options.max_error,
                                  covered_area)) {
    clearModel(result);
    return;
  }
  result.distinct_inliers = verdict.distinctInliers(pairs, result.mask);
  if (scaled) {
    result.covariance = fit.pixelCovariance(problem, h);
  } else {
    result.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  result.status = Status::ok;
}

ProsacHomography::ProsacHomography(const ProsacOptions& options) : impl_(std::make_unique<Impl>()) {
  requireInRange("prosac max_error", options.max_error, 1e-6, 1e6);
  requireInRange("max_iterations", options.max_iterations, 1, 1000000);
  requireInRange("confidence", options.confidence, 1e-6, 1.0 - 1e-9);
  impl_->options = options;
}

ProsacHomography::~ProsacHomography() = default;
ProsacHomography::ProsacHomography(ProsacHomography&&) noexcept = default;
ProsacHomography& ProsacHomography::operator=(ProsacHomography&&) noexcept = default;

const ProsacOptions& ProsacHomography::options() const {
  return impl_->options;
}

void ProsacHomography::estimate(const PointPairs& pairs, const cv::Size& reference_size,
                                ProsacResult& result) {
  impl_->estimate(pairs, reference_size, std::nullopt, result);
}

void ProsacHomography::estimate(const PointPairs& pairs, const cv::Size& reference_size,
                                const std::optional<Eigen::Matrix3d>& initial,
                                ProsacResult& result) {
  impl_->estimate(pairs, reference_size, initial, result);
}

}  // namespace ktgp_orb
