#include "ktgp_orb/prosac_homography.h"

#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "core/homography/fit.h"
#include "core/homography/model.h"
#include "core/homography/transform.h"
#include "core/homography/verdict.h"
#include "core/prosac/prosac.h"
#include "core/util/options_check.h"

namespace ktgp_orb {
namespace {

using util::requireInRange;

// px; their squares and the inverse of these are exact enough in single precision.
constexpr double kLeastNoise = 1e-6;
constexpr double kMostNoise = 1e6;

void requireNoise(const std::vector<double>& noise, std::size_t pairs) {
  if (noise.size() != pairs) {
    throw std::invalid_argument("there are " + std::to_string(noise.size()) + " noises and " +
                                std::to_string(pairs) +
                                " point pairs; expected one per pair, or none");
  }
  for (std::size_t i = 0; i < noise.size(); ++i) {
    if (noise[i] >= kLeastNoise && noise[i] <= kMostNoise) continue;
    requireInRange("noise of point pair " + std::to_string(i) + " in px", noise[i], kLeastNoise,
                   kMostNoise);
  }
}

void requireValid(const std::optional<Eigen::Matrix3d>& initial) {
  if (!initial || initial->allFinite()) return;
  throw std::invalid_argument(
      "the initial homography has an entry that is not finite; expected nine finite entries");
}

double rootMeanSquareNoise(const PointPairs& pairs) {
  if (pairs.noise.empty()) return 1.0;
  double sum = 0.0;
  for (const double noise : pairs.noise) sum += noise * noise;
  return std::sqrt(sum / static_cast<double>(pairs.size()));
}

void reset(std::size_t pairs, ProsacResult& result) {
  std::vector<std::uint8_t> mask = std::move(result.mask);  // keep the buffer
  mask.assign(pairs, 0);
  result = {};
  result.mask = std::move(mask);
}

}  // namespace

/// Search, fit and verdict, with their buffers.
struct ProsacHomography::Impl {
  ProsacOptions options;
  prosac::QualityOrder order;
  homography::NormalisedPairs normalised;
  homography::HomographyProblem problem;
  prosac::ProsacSearch<homography::HomographyProblem> search;
  homography::HomographyFit fit;
  homography::Finaliser finaliser;
  homography::FinalHomography final;

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
  homography::requireFinite(pairs);
  if (!pairs.noise.empty()) requireNoise(pairs.noise, pairs.size());
  requireValid(initial);
  reset(pairs.size(), result);
  if (pairs.size() < homography::HomographyProblem::kSample) {
    result.status = Status::too_few_matches;
    return;
  }
  if (!find(pairs, initial, result)) return;  // no_model
  Eigen::Matrix3d h = search.best();
  switch (fit.fit(normalised, kMinScale, 0.0, h)) {
    case homography::FitOutcome::fitted:
      judge(pairs, reference_size, h, result);
      break;
    case homography::FitOutcome::undetermined:
      result.status = Status::model_rejected;
      break;
    case homography::FitOutcome::unsupported:
      break;  // no_model
  }
}

/// The search; false where no sample gave a homography.
bool ProsacHomography::Impl::find(const PointPairs& pairs,
                                  const std::optional<Eigen::Matrix3d>& initial,
                                  ProsacResult& result) {
  order.sort(pairs.quality);
  normalised.load(pairs.reference, pairs.target, order, options.max_error, pairs.noise);
  prosac::ProsacRules rules;
  rules.max_iterations = options.max_iterations;
  rules.confidence = options.confidence;
  rules.chance_inlier = homography::chanceInlier(homography::coveredArea(pairs.target),
                                                 options.max_error * rootMeanSquareNoise(pairs));
  rules.seed = options.seed;
  const auto start = initial ? normalised.fromPixels(*initial) : std::nullopt;
  problem.setPairs(normalised);
  const prosac::ProsacRun run = search.run(rules, start ? &*start : nullptr, problem);
  result.iterations = run.iterations;
  result.stop = run.exhausted ? ProsacStop::max_iterations : ProsacStop::maximality;
  return run.found;
}

/// Verdict on the normalised homography; fills in what the verdict allows.
void ProsacHomography::Impl::judge(const PointPairs& pairs, const cv::Size& reference_size,
                                   const Eigen::Matrix3d& h, ProsacResult& result) {
  result.status = Status::model_rejected;
  const auto corners = homography::imageCorners(reference_size, pairs.reference);
  UncertainHomography estimate{normalised.toPixels(h)};
  if (!homography::keepsPlaneInView(estimate.homography, corners)) return;
  auto normalised_corners = corners;
  for (Eigen::Vector2d& corner : normalised_corners) corner = normalised.reference.apply(corner);
  if (!fit.isDetermined(normalised, h, normalised_corners)) return;
  const bool scaled = homography::scaleLastToOne(estimate.homography);
  finaliser.finalise(estimate, pairs, reference_size, options.max_error, final);
  if (!final.trusted) return;

  // Last, since it takes longer than the verdict.
  if (scaled) {
    estimate = fit.inPixels(normalised, h, corners, {false, pairs.rounding});
  } else {
    estimate.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
    estimate.shared_covariance = estimate.covariance;
  }
  result.answer = estimate;
  result.mask = final.mask;  // into its own buffer: swapped ones would grow in turn
  result.inliers = final.inliers;
  result.rmse = final.rmse;
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
