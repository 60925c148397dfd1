#include "two_view/hypotheses.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "estimation/student.h"
#include "homography/transform.h"
#include "util/constants.h"

namespace ktgp_orb::two_view {
namespace {

constexpr double kSame = 1.0 * util::kPi / 180.0;  // rad; motions that differ by less count as one

/// Density of Student's t distribution with four degrees of freedom, scale 1, at 0.
constexpr double kDensity = 0.375;

}  // namespace

void Hypotheses::load(const EpipolarPairs& pairs, double cell, double range, const Epipolar& found,
                      const Eigen::Matrix3d* plane) {
  pairs_ = &pairs;
  fit_.setPairs(pairs);
  range_ = range;
  using Points = homography::PointArrays<double>;
  cells_.resize(std::max(Points::kUsualCells, pairs.refinement.findCells(cell, cell_).count()));
  starts_.clear();
  list_.clear();
  scale_ = pairs.limit / 3.0;
  off_plane_.assign(pairs.size(), std::numeric_limits<double>::infinity());
  const std::optional<Eigen::Matrix3d> h =
      plane == nullptr ? std::nullopt : pairs.fromPixels(*plane);
  for (std::size_t i = 0; h && i < pairs.size(); ++i) {
    const Eigen::Vector2d x(pairs.refinement.x[i], pairs.refinement.y[i]);
    const Eigen::Vector2d u(pairs.refinement.u[i], pairs.refinement.v[i]);
    off_plane_[i] = std::sqrt(0.5) * homography::errorOf(*h, x, u) * pairs.precision[i];
  }
  double near[2] = {1.0, 1.0};
  double all[2] = {2.0, 2.0};
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const int kind = pairs.precision[i] < 1.0 ? 1 : 0;
    all[kind] += 1.0;
    near[kind] += pairs.distance(found, i) < pairs.limit ? 1.0 : 0.0;
  }
  for (int kind = 0; kind < 2; ++kind) share_[kind] = std::clamp(near[kind] / all[kind], 0.1, 0.9);
}

void Hypotheses::setGains(Hypothesis& hypothesis) const {
  hypothesis.gains.resize(pairs_->size());
  hypothesis.gain = 0.0;
  for (std::size_t i = 0; i < pairs_->size(); ++i) {
    const double precision = pairs_->precision[i];
    const double share = share_[precision < 1.0 ? 1 : 0];
    const double e = pairs_->distance(hypothesis.geometry, i) * precision / scale_;
    const double t = 1.0 + e * e / estimation::kStudentFreedom;
    const double right = kDensity * precision / scale_ / (t * t * std::sqrt(t));
    hypothesis.gains[i] = std::log1p(share / (1.0 - share) * range_ * right);
    hypothesis.gain += hypothesis.gains[i];
  }
}

bool Hypotheses::isKnown(const Epipolar& geometry) const {
  return std::any_of(list_.begin(), list_.end(), [&](const Hypothesis& h) {
    return apart(h.geometry.motion, geometry.motion) < kSame;
  });
}

void Hypotheses::start(const RelativePose& motion) {
  constexpr int kSteps = 2;
  constexpr std::size_t kVoters = 64;  // this many of the best pairs decide the translation's sign
  RelativePose forward = motion;
  const std::size_t n = std::min(pairs_->size(), kVoters);
  std::size_t front = 0;
  for (std::size_t i = 0; i < n; ++i) {
    front += inFront(motion, pairs_->referenceRay(i), pairs_->targetRay(i)) ? 1 : 0;
  }
  if (2 * front < n) forward.translation *= -1.0;
  Epipolar start = pairs_->fromMotion(forward);
  for (int step = 0; step < kSteps && fit_.step(pairs_->limit, start); ++step) {
  }
  starts_.emplace_back(costOf(*pairs_, start, std::numeric_limits<float>::infinity()), start);
}

void Hypotheses::prefer(const std::vector<RelativePose>& motions) {
  std::vector<Hypothesis> others;
  std::swap(others, list_);
  for (const RelativePose& motion : motions) {
    list_.push_back({pairs_->fromMotion(motion)});
    setGains(list_.back());
  }
  judge();
  // The old best motion was fitted freely, so it always agrees better than the new motions. It gets
  // at most the probability of the best new motion.
  if (!others.empty() && !isKnown(others.front().geometry)) {
    const double lead = difference(others.front(), list_.front());
    others.front().probability = std::exp(std::min(lead, 0.0)) * list_.front().probability;
    list_.push_back(std::move(others.front()));
  }
  double all = 0.0;
  for (const Hypothesis& h : list_) all += h.probability;
  for (Hypothesis& h : list_) h.probability /= all;
}

/// Adds each fitted motion to the list with both signs of its translation, because the epipolar
/// lines are the same for both signs; only the chirality differs.
void Hypotheses::refine() {
  constexpr std::size_t kMost = 4;  // maximum number of fits
  // A start is not fitted if its cost is more than this multiple of the lowest cost.
  constexpr float kMostCost = 2.0F;
  // Minimum of `scale_`, as a share of the limit (0.1 px for the default max_error). It is needed
  // because smooth errors do not show in the residuals.
  constexpr double kLeastScale = 0.07;
  std::stable_sort(starts_.begin(), starts_.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  double least = pairs_->limit;
  for (auto& [cost, geometry] : starts_) {
    if (list_.size() == 2 * kMost || cost > kMostCost * starts_.front().first) break;
    if (isKnown(geometry) || !fit_.minimise(geometry) || isKnown(geometry)) continue;
    least = std::min(least, fit_.scale());
    const RelativePose& motion = geometry.motion;
    list_.push_back({geometry});
    list_.push_back({pairs_->fromMotion({motion.rotation, -motion.translation})});
  }
  scale_ = std::max(least, kLeastScale * pairs_->limit);
  for (Hypothesis& h : list_) setGains(h);
  std::stable_sort(list_.begin(), list_.end(),
                   [](const Hypothesis& a, const Hypothesis& b) { return a.gain > b.gain; });
  if (!list_.empty()) judge();
}

double Hypotheses::difference(const Hypothesis& a, const Hypothesis& b) const {
  // If the whole difference comes from a single cell, the difference is limited to this value; the
  // less likely motion then keeps a probability of 0.27.
  constexpr double kMostOfACell = 1.0;
  // A pair on the plane is left out if its two gains differ by less than this. Noise of three
  // standard deviations can cause such a difference.
  constexpr double kIndifferent = 3.0;
  // A pair that is nearer to the plane than this many standard deviations is on the plane; noise
  // exceeds this limit in 1 of 25 000 pairs.
  constexpr double kOnPlane = 4.5;
  std::fill(cells_.begin(), cells_.end(), 0.0);
  double sum = 0.0;
  double independent = 0.0;
  for (std::size_t i = 0; i < a.gains.size(); ++i) {
    const double d = a.gains[i] - b.gains[i];
    if (off_plane_[i] < kOnPlane * scale_ && std::abs(d) < kIndifferent) continue;
    sum += d;
    independent += d * d;
    cells_[cell_[i]] += d;
  }
  double clustered = 1e-300;
  for (const double cell : cells_) clustered += cell * cell;
  const double least = std::min(std::abs(sum) * std::min(1.0, independent / clustered),
                                kMostOfACell * sum * sum / clustered);
  return std::copysign(least, sum);
}

double Hypotheses::leadOver(const RelativePose& motion) const {
  Hypothesis other{pairs_->fromMotion(motion)};
  setGains(other);
  return difference(list_.front(), other);
}

/// Sets the probabilities. The first motion stays first unless another motion is more probable.
void Hypotheses::judge() {
  constexpr double kMost = 300.0;  // exp(kMost) is finite
  double all = 0.0;
  for (Hypothesis& h : list_) {
    all += h.probability = std::exp(std::min(-difference(list_.front(), h), kMost));
  }
  for (Hypothesis& h : list_) h.probability /= all;
  std::stable_sort(list_.begin(), list_.end(), [](const Hypothesis& a, const Hypothesis& b) {
    return a.probability > b.probability;
  });
}

}  // namespace ktgp_orb::two_view
