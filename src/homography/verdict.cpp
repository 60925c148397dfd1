#include "homography/verdict.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "estimation/false_alarms.h"
#include "homography/fit.h"
#include "homography/part_in_view.h"
#include "util/constants.h"

namespace ktgp_orb::homography {
using util::kPi;

namespace {

constexpr double kLogMaxFalseAlarms = -4.0;  // log10 of the largest accepted NFA

/// Sets `result` as label() does, and calls visit(index, squared error in px²) for each inlier.
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
  // If a homography shows the whole reference image from one side (see keepsPlaneInView), it is
  // probably right, because a wrong homography seldom does so. If the plane is only partly in view,
  // this evidence is missing, so the inliers must be more significant.
  constexpr double kLogMaxOfAPart = -12.0;  // log10 of the largest accepted NFA
  const FourPoints corners = imageCorners(reference_size, pairs.reference);
  const Eigen::Matrix3d view = facing(answer.homography);
  double farthest = 0.0;
  for (const Eigen::Vector2d& corner : corners) {
    farthest = std::max(farthest, view.row(2).dot(corner.homogeneous()));
  }
  squared_error_.resize(pairs.size());
  inliers_.clear();
  labelEach(answer, pairs, threshold, result, [&](std::size_t i, double squared_error) {
    squared_error_[i] = squared_error;
    const double depth = view.row(2).dot(pairs.reference[i].homogeneous());
    if (depth > kAtHorizon * farthest) inliers_.push_back(i);
  });
  if (!(view.determinant() > 0.0)) return false;
  const bool shows_all = keepsPlaneInView(view, corners);
  return !explainableByChance(pairs, threshold, shows_all ? kLogMaxFalseAlarms : kLogMaxOfAPart);
}

bool HomographyVerdict::explainableByChance(const PointPairs& pairs, double threshold,
                                            double log_limit) {
  const double covered_area = estimation::coveredArea(pairs.target);
  // The bound on the number of false alarms holds for any order of the inliers, if we use the
  // largest error of the inliers counted so far. A good homography is accepted after a few inliers,
  // in the order of the input. Only if it is not accepted in this order do we have to sort the
  // inliers.
  if (!explainable(pairs, threshold, covered_area, log_limit)) return false;
  std::sort(inliers_.begin(), inliers_.end(), [&](std::size_t a, std::size_t b) {
    return squared_error_[a] != squared_error_[b] ? squared_error_[a] < squared_error_[b] : a < b;
  });
  return explainable(pairs, threshold, covered_area, log_limit);
}

/// Returns true if chance can explain the inliers, counted in the order of inliers_.
bool HomographyVerdict::explainable(const PointPairs& pairs, double threshold, double covered_area,
                                    double log_limit) {
  constexpr std::size_t kSample = HomographyProblem::kSample;
  estimation::FalseAlarms false_alarms(kSample, pairs.size());
  const double apart2 = threshold * threshold;
  double largest = 0.0;  // largest squared error of the inliers so far, px²
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
  if (!(pairs.rounding >= 0.0 && std::isfinite(pairs.rounding))) {
    throw std::invalid_argument("rounding of the point pairs is " + std::to_string(pairs.rounding) +
                                "; expected a standard deviation of at least 0 px");
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
