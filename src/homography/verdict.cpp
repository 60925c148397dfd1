#include "homography/verdict.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "homography/fit.h"
#include "homography/part_in_view.h"
#include "util/constants.h"
#include "util/divide.h"

namespace ktgp_orb::homography {
namespace {

using util::kPi;

constexpr double kLogMaxFalseAlarms = -4.0;  // log10

/// Bounds of one coordinate, from the quartiles of a few points, spread over the input; points
/// beyond are far outliers. The bounds stay where the quartiles are equal.
void setFences(const std::vector<Eigen::Vector2d>& points, Eigen::Index axis,
               Eigen::AlignedBox2d& fences) {
  constexpr std::size_t kEnough = 32;
  constexpr double kFarOut = 3.0;  // interquartile ranges
  std::array<double, kEnough> sample{};
  const std::size_t stride = util::ceilDivide(points.size(), kEnough);
  std::size_t count = 0;
  for (std::size_t i = 0; i < points.size(); i += stride) sample[count++] = points[i][axis];
  if (count == 0) return;
  const auto end = sample.begin() + static_cast<std::ptrdiff_t>(count);
  const auto quartile = [&](std::size_t place) {
    const auto at = sample.begin() + static_cast<std::ptrdiff_t>(place);
    std::nth_element(sample.begin(), at, end);
    return *at;
  };
  const double lower = quartile(count / 4);
  const double upper = quartile(count - 1 - count / 4);
  if (!(upper > lower)) return;
  const double reach = kFarOut * (upper - lower);
  fences.min()[axis] = lower - reach;
  fences.max()[axis] = upper + reach;
}

}  // namespace

FalseAlarms::FalseAlarms(std::size_t sample_size, std::size_t pairs)
    : m_(static_cast<double>(sample_size)), n_(static_cast<double>(pairs)), k_(m_) {
  for (std::size_t i = 1; i <= sample_size; ++i) {
    const double x = static_cast<double>(i);
    log_subsets_ += std::log10((n_ - m_ + x) / x);
  }
  log_subsets_ += std::log10(std::max(n_ - m_, 1.0));
}

double FalseAlarms::next(double p) {
  // From k to k + 1, C(N, k) C(k, m) becomes (N - k) / (k + 1 - m) times as much.
  log_subsets_ += std::log10((n_ - k_) / (k_ + 1.0 - m_));
  k_ += 1.0;
  return log_subsets_ + (k_ - m_) * std::log10(std::min(p, 1.0));
}

double coveredArea(const std::vector<Eigen::Vector2d>& points) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Eigen::AlignedBox2d fences(Eigen::Vector2d::Constant(-kInfinity),
                             Eigen::Vector2d::Constant(kInfinity));
  setFences(points, 0, fences);
  setFences(points, 1, fences);
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : points) {
    if (fences.contains(p)) box.extend(p);
  }
  return box.isEmpty() ? 0.0 : box.volume();
}

double chanceInlier(double covered_area, double distance) {
  constexpr double kLeast = 0.01;
  constexpr double kMost = 0.5;
  const double disc = kPi * distance * distance;
  return std::clamp(disc / std::max(covered_area, disc), kLeast, kMost);
}

bool HomographyVerdict::trusts(const Eigen::Matrix3d& homography, const PointPairs& pairs,
                               const cv::Size& reference_size, double threshold) {
  const FourPoints corners = imageCorners(reference_size, pairs.reference);
  // A wrong homography seldom shows the whole image from one side. A plane that is seen in part
  // lacks this evidence, and has to make up for it by its inliers.
  constexpr double kLogMaxOfAPart = -12.0;  // log10
  const Eigen::Matrix3d view = facing(homography);
  if (!(view.determinant() > 0.0)) return false;
  const bool shows_all = keepsPlaneInView(view, corners);
  double farthest = 0.0;
  for (const Eigen::Vector2d& corner : corners) {
    farthest = std::max(farthest, view.row(2).dot(corner.homogeneous()));
  }
  squared_error_.resize(pairs.size());
  inliers_.clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = errorOf(homography, pairs.reference[i], pairs.target[i]);
    squared_error_[i] = error * error;
    const double depth = view.row(2).dot(pairs.reference[i].homogeneous());
    if (error < threshold && depth > kAtHorizon * farthest) inliers_.push_back(i);
  }
  return !explainableByChance(pairs, threshold, shows_all ? kLogMaxFalseAlarms : kLogMaxOfAPart);
}

bool HomographyVerdict::explainableByChance(const PointPairs& pairs, double threshold,
                                            double log_limit) {
  const double covered_area = coveredArea(pairs.target);
  // The bound holds for any order, with the largest error so far. Good homographies pass after a
  // few inliers in the order of the input; only poor ones need sorting.
  if (!explainable(pairs, threshold, covered_area, log_limit)) return false;
  std::sort(inliers_.begin(), inliers_.end(), [&](std::size_t a, std::size_t b) {
    return squared_error_[a] != squared_error_[b] ? squared_error_[a] < squared_error_[b] : a < b;
  });
  return explainable(pairs, threshold, covered_area, log_limit);
}

/// The test with the inliers in their current order.
bool HomographyVerdict::explainable(const PointPairs& pairs, double threshold, double covered_area,
                                    double log_limit) {
  constexpr std::size_t kSample = HomographyProblem::kSample;
  FalseAlarms false_alarms(kSample, pairs.size());
  const double apart2 = threshold * threshold;
  double largest = 0.0;  // squared error, px²
  counted_.clear();
  for (const std::size_t candidate : inliers_) {
    const auto is_apart = [&](std::size_t other) {
      return (pairs.reference[other] - pairs.reference[candidate]).squaredNorm() > apart2 &&
             (pairs.target[other] - pairs.target[candidate]).squaredNorm() > apart2;
    };
    if (!std::all_of(counted_.begin(), counted_.end(), is_apart)) continue;
    counted_.push_back(candidate);
    largest = std::max(largest, squared_error_[candidate]);
    if (counted_.size() <= kSample) continue;
    const double chance = kPi * std::max(largest, 1.0 / kPi) / covered_area;
    if (false_alarms.next(chance) < log_limit) return false;
  }
  return true;
}

void requireFinite(const PointPairs& pairs) {
  const std::size_t n = pairs.size();
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

void label(const UncertainHomography& answer, const PointPairs& pairs, double max_error,
           ProsacResult& result) {
  result.answer = answer;
  result.mask.resize(pairs.size());
  result.inliers = 0;
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = errorOf(answer.homography, pairs.reference[i], pairs.target[i]);
    result.mask[i] = error < max_error ? 1 : 0;
    if (result.mask[i] == 0) continue;
    ++result.inliers;
    sum += error * error;
  }
  result.rmse = result.inliers > 0 ? std::sqrt(sum / static_cast<double>(result.inliers)) : 0.0;
}

}  // namespace ktgp_orb::homography
