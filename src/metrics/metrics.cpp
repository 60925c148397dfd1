#include "ktgp_orb/metrics.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "homography/part_in_view.h"
#include "util/keypoint_position.h"

namespace ktgp_orb::metrics {
namespace {

using util::position;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

class Accumulator {
 public:
  void add(double value) {
    ++count_;
    sum_ += value;
    sum_of_squares_ += value * value;
  }
  ErrorSummary summary() const {
    if (count_ == 0) return {};
    const auto n = static_cast<double>(count_);
    return {count_, sum_ / n, std::sqrt(sum_of_squares_ / n)};
  }

 private:
  std::size_t count_ = 0;
  double sum_ = 0.0;
  double sum_of_squares_ = 0.0;
};

double share(std::size_t part, std::size_t whole) {
  return whole > 0 ? static_cast<double>(part) / static_cast<double>(whole) : 0.0;
}

}  // namespace

ErrorSummary summarize(const std::vector<double>& values) {
  Accumulator accumulator;
  for (double value : values) accumulator.add(value);
  return accumulator.summary();
}

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return 0.5 * (values[(n - 1) / 2] + values[n / 2]);
}

ErrorSummary descriptorDistance(const std::vector<Correspondence>& correspondences, Level level) {
  Accumulator accumulator;
  for (const Correspondence& c : correspondences) {
    if (c.level >= level) accumulator.add(c.distance);
  }
  return accumulator.summary();
}

ErrorSummary displacement(const Features& reference, const Features& target,
                          const std::vector<Correspondence>& matches) {
  Accumulator accumulator;
  for (const Correspondence& c : matches) {
    const Eigen::Vector2d motion =
        position(target, c.target_index) - position(reference, c.reference_index);
    accumulator.add(motion.norm());
  }
  return accumulator.summary();
}

double retention(std::size_t kept, std::size_t total) {
  return share(kept, total);
}

double matchedShare(std::size_t matches, const Features& reference, const Features& target) {
  return share(2 * matches, reference.size() + target.size());
}

Eigen::Vector2d project(const Eigen::Matrix3d& homography, const Eigen::Vector2d& x) {
  const Eigen::Vector3d p = ktgp_orb::homography::facing(homography) * x.homogeneous();
  if (!(p.z() > 0.0)) return {kInfinity, kInfinity};
  return p.hnormalized();
}

std::vector<double> reprojectionErrors(const Eigen::Matrix3d& homography, const Features& reference,
                                       const Features& target,
                                       const std::vector<Correspondence>& matches) {
  std::vector<double> errors;
  errors.reserve(matches.size());
  for (const Correspondence& c : matches) {
    const Eigen::Vector2d expected = project(homography, position(reference, c.reference_index));
    errors.push_back((expected - position(target, c.target_index)).norm());
  }
  return errors;
}

std::size_t countWithin(const std::vector<double>& errors, double threshold) {
  return static_cast<std::size_t>(
      std::count_if(errors.begin(), errors.end(), [&](double e) { return e <= threshold; }));
}

double precision(const std::vector<double>& errors, double threshold) {
  return share(countWithin(errors, threshold), errors.size());
}

double cornerError(const Eigen::Matrix3d& estimated, const Eigen::Matrix3d& truth,
                   const cv::Size& reference_size) {
  const double right = reference_size.width - 1.0;
  const double bottom = reference_size.height - 1.0;
  const std::array<Eigen::Vector2d, 4> corners{
      {{0.0, 0.0}, {right, 0.0}, {right, bottom}, {0.0, bottom}}};
  double sum = 0.0;
  for (const Eigen::Vector2d& corner : corners) {
    sum += (project(estimated, corner) - project(truth, corner)).norm();
  }
  return std::isnan(sum) ? kInfinity : sum / static_cast<double>(corners.size());
}

double areaUnderCurve(const std::vector<double>& errors, double threshold) {
  std::vector<double> sorted(errors);
  std::sort(sorted.begin(), sorted.end());
  double area = 0.0;   // area under the curve (number of pairs over error) so far, px
  double share = 0.0;  // number of pairs whose error is at most `last`
  double last = 0.0;
  for (const double error : sorted) {
    if (error >= threshold) break;
    // Trapezoid from `last` to `error`: the number of pairs is `share` at its left end and `share`
    // + 1 at its right end.
    area += (share + 0.5) * (error - last);
    share += 1.0;
    last = error;
  }
  area += share * (threshold - last);
  return errors.empty() ? 0.0 : area / (static_cast<double>(errors.size()) * threshold);
}

}  // namespace ktgp_orb::metrics
