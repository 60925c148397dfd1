#include "homography/verdict.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "estimation/false_alarms.h"
#include "homography/fit.h"
#include "homography/transform.h"
#include "util/constants.h"

namespace ktgp_orb::homography {
using util::kPi;

namespace {

/// label(), and visits the number and the squared error, px², of each inlier.
template <typename Visit>
void labelEach(const UncertainHomography& answer, const PointPairs& pairs, double max_error,
               ProsacResult& result, const Visit& visit) {
  result.answer = answer;
  result.mask.assign(pairs.size(), 0);
  result.inliers = 0;
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = errorOf(answer.homography, pairs.reference[i], pairs.target[i]);
    if (!(error < max_error)) continue;
    result.mask[i] = 1;
    ++result.inliers;
    sum += error * error;
    visit(i, error * error);
  }
  result.rmse = result.inliers > 0 ? std::sqrt(sum / static_cast<double>(result.inliers)) : 0.0;
}

}  // namespace

bool HomographyVerdict::trusts(const UncertainHomography& answer, const PointPairs& pairs,
                               const cv::Size& reference_size, double threshold,
                               ProsacResult& result) {
  squared_error_.resize(pairs.size());
  inliers_.clear();
  labelEach(answer, pairs, threshold, result, [this](std::size_t i, double squared_error) {
    squared_error_[i] = squared_error;
    inliers_.push_back(i);
  });
  const Eigen::Matrix3d& h = answer.homography;
  const FourPoints corners = imageCorners(reference_size, pairs.reference);
  // When the origin is far from all points, H(2,2) = 1 may change the sign of the third coordinate.
  const double sign = h.row(2).dot(corners[0].homogeneous()) < 0.0 ? -1.0 : 1.0;
  return keepsPlaneInView(sign * h, corners) && !explainableByChance(pairs, threshold);
}

bool HomographyVerdict::explainableByChance(const PointPairs& pairs, double threshold) {
  const double covered_area = estimation::coveredArea(pairs.target);
  // The bound holds for any order, with the largest error so far. Good homographies pass after a
  // few inliers in the order of the input; only poor ones need sorting.
  if (!explainable(pairs, threshold, covered_area)) return false;
  std::sort(inliers_.begin(), inliers_.end(), [&](std::size_t a, std::size_t b) {
    return squared_error_[a] != squared_error_[b] ? squared_error_[a] < squared_error_[b] : a < b;
  });
  return explainable(pairs, threshold, covered_area);
}

/// The test with the inliers in their current order.
bool HomographyVerdict::explainable(const PointPairs& pairs, double threshold,
                                    double covered_area) {
  constexpr double kLogMaxFalseAlarms = -4.0;  // log10
  constexpr std::size_t kSample = HomographyProblem::kSample;
  estimation::FalseAlarms false_alarms(kSample, pairs.size());
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
    if (false_alarms.next(chance) < kLogMaxFalseAlarms) return false;
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
  labelEach(answer, pairs, max_error, result, [](std::size_t, double) {});
}

}  // namespace ktgp_orb::homography
