#include "ktgp_orb/prosac_homography.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "homography_checks.h"
#include "homography_points.h"
#include "homography_refinement.h"
#include "homography_score.h"
#include "homography_solver.h"
#include "options_check.h"
#include "prosac_sampler.h"
#include "prosac_stopping.h"
#include "prosac_verdict.h"

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

/// An integer that orders as the number in single precision does.
std::uint64_t sortKey(double quality) {
  const float single = static_cast<float>(quality) + 0.0F;  // -0 becomes 0
  std::uint32_t bits = 0;
  std::memcpy(&bits, &single, sizeof bits);
  const std::uint32_t sign = bits >> 31;
  return bits ^ (sign != 0 ? 0xffffffffU : 0x80000000U);
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
  std::vector<std::uint64_t> order;  // quality in the upper half, index in the lower; best first
  Normalisation reference, target;
  PointArrays<float> points;          // normalised, in order of quality, for scoring
  PointArrays<double> exact;          // the same in double precision, for refinement
  double limit = 0.0;                 // the threshold in normalised target units
  std::vector<std::uint8_t> inlier;   // of the best model, in order of quality
  std::vector<std::uint8_t> refined;  // the pairs that the refinement used last
  std::vector<double> squared_error;  // of the final model, px², in input order
  HomographyRefinement refinement;
  ProsacStopping stopping;
  ProsacVerdict verdict;

  void load(const PointPairs& pairs, double threshold);
  bool solve(const ProsacSampler::Sample& sample, double threshold, Eigen::Matrix3d& h) const;
  float polish(float cost, Eigen::Matrix3d& h);
};

void ProsacHomography::Workspace::load(const PointPairs& pairs, double threshold) {
  const std::size_t n = pairs.size();
  order.resize(n);
  for (std::size_t i = 0; i < n; ++i) order[i] = sortKey(pairs.quality[i]) << 32 | i;
  std::sort(order.begin(), order.end());
  reference = Normalisation::of(pairs.reference);
  target = Normalisation::of(pairs.target);
  limit = threshold * target.scale;
  points.resize(n);
  exact.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t index = order[i] & 0xffffffffU;
    const Eigen::Vector2d x = reference.apply(pairs.reference[index]);
    const Eigen::Vector2d u = target.apply(pairs.target[index]);
    points.set(i, x, u);
    exact.set(i, x, u);
  }
}

bool ProsacHomography::Workspace::solve(const ProsacSampler::Sample& sample, double threshold,
                                        Eigen::Matrix3d& h) const {
  FourPoints from;
  FourPoints to;
  for (std::size_t i = 0; i < kSampleSize; ++i) {
    from[i] = {exact.x[sample[i]], exact.y[sample[i]]};
    to[i] = {exact.u[sample[i]], exact.v[sample[i]]};
  }
  const double min_area = threshold * threshold;
  return solveFourPoints(from, to, min_area * reference.scale * reference.scale,
                         min_area * target.scale * target.scale, h);
}

/// Local optimisation (Chum, Matas & Kittler, DAGM 2003): a step over the inliers, from a wide
/// limit down to the threshold. Returns the cost of the best model met, which `h` becomes.
float ProsacHomography::Workspace::polish(float cost, Eigen::Matrix3d& h) {
  constexpr std::size_t kEnough = 200;  // inliers, the best by quality; more would not find more
  Eigen::Matrix3d candidate = h;
  for (double widening : {2.0, 1.5, 1.0, 1.0}) {
    findInliers(points, candidate, widening * limit, inlier);
    if (refinement.select(exact, inlier, kEnough) <= kSampleSize) break;
    if (!refinement.step(widening * limit / 3.0, candidate)) break;
    const float candidate_cost = msacCost(points, candidate, limit, cost);
    if (candidate_cost >= cost) continue;
    cost = candidate_cost;
    h = candidate;
  }
  return cost;
}

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
  requireValid(pairs);
  reset(pairs.size(), result);
  if (pairs.size() < kSampleSize) {
    result.status = Status::too_few_matches;
    return;
  }
  workspace_->load(pairs, options_.threshold);
  Eigen::Matrix3d h;
  if (!search(result, h)) return;  // no_model
  conclude(pairs, reference_size, h, result);
}

/// Chum & Matas' loop: samples from the best pairs until both stopping rules are content. False
/// where no sample gave a model.
bool ProsacHomography::search(ProsacResult& result, Eigen::Matrix3d& best) {
  Workspace& work = *workspace_;
  const std::size_t n = work.points.size;
  ProsacSampler sampler(n, options_.max_iterations, options_.seed);
  work.stopping.reset(n, 0.01, options_.confidence);
  float best_cost = std::numeric_limits<float>::infinity();
  result.stop = ProsacStop::max_iterations;
  while (sampler.drawn() < options_.max_iterations) {
    const ProsacSampler::Sample sample = sampler.draw(work.stopping.terminationLength());
    Eigen::Matrix3d model;
    if (work.solve(sample, options_.threshold, model)) {
      float cost = msacCost(work.points, model, work.limit, best_cost);
      if (cost < best_cost) {
        cost = work.polish(cost, model);
        ++result.local_optimisations;
        best = model;
        best_cost = cost;
        findInliers(work.points, best, work.limit, work.inlier);
        work.stopping.update(work.inlier);
      }
    }
    if (sampler.drawn() >= work.stopping.samplesNeeded()) {
      result.stop = ProsacStop::maximality;
      break;
    }
  }
  result.iterations = sampler.drawn();
  result.growth_set_size = sampler.growthSetSize();
  return best_cost < std::numeric_limits<float>::infinity();
}

namespace {

/// Squared reprojection errors, mask, inliers and RMSE of the final homography, in pixels.
void applyThreshold(const PointPairs& pairs, double threshold, std::vector<double>& squared_error,
                    ProsacResult& result) {
  squared_error.resize(pairs.size());
  double sum = 0.0;
  result.inliers = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = reprojectionError(result.homography, pairs.reference[i], pairs.target[i]);
    squared_error[i] = error * error;
    result.mask[i] = error < threshold ? 1 : 0;
    if (result.mask[i] == 0) continue;
    ++result.inliers;
    sum += error * error;
  }
  result.rmse = result.inliers > 0 ? std::sqrt(sum / static_cast<double>(result.inliers)) : 0.0;
}

/// Covariance of the pixel homography's entries from that of the normalised one's, by the chain
/// rule through T_target^-1 H T_reference and the division by its last entry.
Matrix8 pixelCovariance(const Matrix8& covariance, const Normalisation& reference,
                        const Normalisation& target, const Eigen::Matrix3d& pixel, double last) {
  Matrix8 jacobian;
  for (int j = 0; j < 8; ++j) {
    Eigen::Matrix3d unit = Eigen::Matrix3d::Zero();
    unit(j / 3, j % 3) = 1.0;
    const Eigen::Matrix3d column = target.inverse() * unit * reference.matrix();
    for (int i = 0; i < 8; ++i) {
      jacobian(i, j) = (column(i / 3, i % 3) - pixel(i / 3, i % 3) * column(2, 2)) / last;
    }
  }
  return jacobian * covariance * jacobian.transpose();
}

}  // namespace

void ProsacHomography::conclude(const PointPairs& pairs, const cv::Size& reference_size,
                                const Eigen::Matrix3d& best, ProsacResult& result) {
  constexpr int kMaxRounds = 10;
  constexpr double kMinScale = 1e-4;  // px
  // Reach of the refinement, in thresholds. The weights tell good pairs from bad ones better than
  // the threshold does, so the refinement sees the pairs just beyond it as well.
  constexpr double kRefinementReach = 2.0;
  constexpr double kMaxCornerDeviation = 20.0;  // px
  Workspace& work = *workspace_;
  Eigen::Matrix3d h = best;
  bool determined = true;
  double scale = work.limit / kRefinementReach;
  for (int round = 0; round < kMaxRounds && determined; ++round) {
    const std::size_t inliers =
        findInliers(work.points, h, kRefinementReach * work.limit, work.inlier);
    if (inliers <= kSampleSize) return;  // nothing but the sample: no_model
    if (round > 0 && work.inlier == work.refined) break;
    work.refined = work.inlier;
    work.refinement.select(work.exact, work.inlier, inliers);
    determined = work.refinement.minimise(kMinScale * work.target.scale, scale, h);
  }
  result.status = Status::model_rejected;
  if (!determined) return;
  const Matrix8 covariance = work.refinement.covariance();
  auto corners = imageCorners(reference_size, pairs.reference);
  const Eigen::Matrix3d pixel = work.target.inverse() * h * work.reference.matrix();
  if (!keepsPlaneInView(pixel, corners)) return;
  for (Eigen::Vector2d& corner : corners) corner = work.reference.apply(corner);
  if (!(cornerDeviation(h, covariance, corners) < kMaxCornerDeviation * work.target.scale)) return;
  const bool scalable = std::abs(pixel(2, 2)) > 1e-9 * pixel.norm();
  const double last = scalable ? pixel(2, 2) : pixel.norm();
  result.homography = pixel / last;
  if (scalable) result.homography(2, 2) = 1.0;
  applyThreshold(pairs, options_.threshold, work.squared_error, result);
  if (work.verdict.explainableByChance(pairs, result.mask, work.squared_error,
                                       options_.threshold)) {
    const ProsacStop stop = result.stop;
    (void)stop;
    result.homography.setZero();
    std::fill(result.mask.begin(), result.mask.end(), std::uint8_t{0});
    result.inliers = 0;
    result.rmse = 0.0;
    return;
  }
  result.distinct_inliers = work.verdict.distinctInliers(pairs, result.mask);
  if (scalable) {
    result.covariance =
        pixelCovariance(covariance, work.reference, work.target, result.homography, last);
  }
  result.status = Status::ok;
}

}  // namespace ktgp_orb
