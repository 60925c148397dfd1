#include "ktgp_orb/prosac_homography.h"

#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include "estimation/false_alarms.h"
#include "homography/fit.h"
#include "homography/transform.h"
#include "homography/verdict.h"
#include "util/options_check.h"
#include "util/reset_keeping.h"

namespace ktgp_orb {
/// The parts of the estimation (search, fit and verdict), with their buffers.
struct ProsacHomography::Impl {
  ProsacOptions options;
  estimation::QualityOrder order;
  homography::NormalisedPairs normalised;
  homography::HomographyProblem problem;
  estimation::ProsacSearch<homography::HomographyProblem> search;
  homography::HomographyFit fit;
  homography::HomographyVerdict verdict;
  ProsacResult labelled;

  bool find(const PointPairs& pairs, const std::optional<Eigen::Matrix3d>& initial,
            ProsacResult& result);
  void judge(const PointPairs& pairs, const cv::Size& reference_size, ProsacResult& result);
};

/// Runs the search; returns false if it found no homography.
bool ProsacHomography::Impl::find(const PointPairs& pairs,
                                  const std::optional<Eigen::Matrix3d>& initial,
                                  ProsacResult& result) {
  order.sort(pairs.quality);
  const auto by_quality = [this](std::size_t place) { return order[place]; };
  normalised.load(pairs.reference, pairs.target, by_quality, options.max_error);
  estimation::ProsacRules rules{options.max_iterations, options.confidence};
  rules.chance_inlier =
      estimation::chanceInlier(estimation::coveredArea(pairs.target), options.max_error);
  rules.seed = options.seed;
  problem.setPairs(normalised);
  const auto start = initial ? normalised.fromPixels(*initial) : std::nullopt;
  const bool found = search.run(rules, start, problem);
  result.iterations = search.iterations();
  result.stop = search.exhausted() ? ProsacStop::max_iterations : ProsacStop::maximality;
  return found;
}

/// Fits the homography that the search found, and sets the result if the verdict trusts this
/// homography.
void ProsacHomography::Impl::judge(const PointPairs& pairs, const cv::Size& reference_size,
                                   ProsacResult& result) {
  homography::EvidenceOptions evidence;
  evidence.max_error = options.max_error;
  evidence.rounding = pairs.rounding;
  const auto corners = homography::imageCorners(reference_size, pairs.reference);
  Eigen::Matrix3d h = search.best();
  result.status = fit.fit(normalised, corners, evidence, h);
  if (result.status != Status::ok) return;
  result.status = Status::model_rejected;
  UncertainHomography answer{normalised.toPixels(h)};
  if (!fit.isDetermined(normalised, corners, h)) return;
  const bool scaled = homography::scaleLastToOne(answer.homography);
  if (!verdict.trusts(answer, pairs, reference_size, options.max_error, labelled)) return;

  // Compute the uncertainty last, because it takes longer than the verdict, which may reject H.
  if (scaled) {
    answer = fit.inPixels(normalised, corners, evidence, h);
  } else {
    answer.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
    answer.shared_covariance = answer.covariance;
  }
  result.answer = answer;
  std::swap(result.mask, labelled.mask);
  result.inliers = labelled.inliers;
  result.rmse = labelled.rmse;
  result.status = Status::ok;
}

ProsacHomography::ProsacHomography(const ProsacOptions& options) : impl_(std::make_unique<Impl>()) {
  util::requireInRange("prosac max_error", options.max_error, 1e-6, 1e6);
  util::requireInRange("max_iterations", options.max_iterations, 1, 1000000);
  util::requireInRange("confidence", options.confidence, 1e-6, 1.0 - 1e-9);
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
  estimate(pairs, reference_size, std::nullopt, result);
}

void ProsacHomography::estimate(const PointPairs& pairs, const cv::Size& reference_size,
                                const std::optional<Eigen::Matrix3d>& initial,
                                ProsacResult& result) {
  homography::requireFinite(pairs);
  if (initial && !initial->allFinite()) {
    throw std::invalid_argument(
        "the initial homography has an entry that is not finite; expected nine finite entries");
  }
  util::resetKeeping(&ProsacResult::mask, result);
  result.mask.assign(pairs.size(), 0);
  if (pairs.size() < homography::HomographyProblem::kSample) {
    result.status = Status::too_few_matches;
    return;
  }
  if (impl_->find(pairs, initial, result)) impl_->judge(pairs, reference_size, result);
}

}  // namespace ktgp_orb
