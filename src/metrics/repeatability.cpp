#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "ktgp_orb/metrics.h"
#include "util/constants.h"

namespace ktgp_orb::metrics {
namespace {

// Radius of a disc, px. Before we compute the overlap of a reference region and a target region, we
// scale both so that the reference region, mapped to the target image, has the area of this disc.
constexpr double kNormalisedRadius = 30.0;

/// An ellipse: the set of points x with (x - centre)^T shape (x - centre) <= 1.
struct Ellipse {
  Eigen::Vector2d centre;
  Eigen::Matrix2d shape;

  double area() const { return util::kPi / std::sqrt(shape.determinant()); }
  double halfHeight() const { return std::sqrt(shape(0, 0) / shape.determinant()); }
};

/// Returns the x coordinates of the left and the right end of the chord that the horizontal line at
/// `y` cuts out of the ellipse. If the line misses the ellipse, right < left.
std::pair<double, double> chordAt(const Ellipse& e, double y) {
  const double v = y - e.centre.y();
  const double a = e.shape(0, 0);
  const double b = e.shape(0, 1) * v;
  const double discriminant = b * b - a * (e.shape(1, 1) * v * v - 1.0);
  if (discriminant < 0.0) return {1.0, 0.0};
  const double middle = e.centre.x() - b / a;
  const double half = std::sqrt(discriminant) / a;
  return {middle - half, middle + half};
}

/// Returns the area of the intersection of two ellipses: sums their exact common chords at `rows`
/// heights by the midpoint rule.
double intersectionArea(const Ellipse& a, const Ellipse& b, int rows) {
  const double top = std::max(a.centre.y() - a.halfHeight(), b.centre.y() - b.halfHeight());
  const double bottom = std::min(a.centre.y() + a.halfHeight(), b.centre.y() + b.halfHeight());
  if (!(bottom > top)) return 0.0;
  const double step = (bottom - top) / rows;
  double area = 0.0;
  for (int row = 0; row < rows; ++row) {
    const double y = top + (row + 0.5) * step;
    const auto [left_a, right_a] = chordAt(a, y);
    const auto [left_b, right_b] = chordAt(b, y);
    area += std::max(0.0, std::min(right_a, right_b) - std::max(left_a, left_b)) * step;
  }
  return area;
}

/// Returns 1 - intersection/union of the two regions, after scaling both so that `a` has the area
/// of a disc with the radius kNormalisedRadius. The distance between the centres is not scaled,
/// because otherwise large regions would always overlap enough.
double overlapError(Ellipse a, Ellipse b, int rows) {
  const double factor = kNormalisedRadius * kNormalisedRadius * util::kPi / a.area();
  a.shape /= factor;
  b.shape /= factor;
  const double intersection = intersectionArea(a, b, rows);
  return 1.0 - intersection / (a.area() + b.area() - intersection);
}

Eigen::Vector2d positionOf(const cv::KeyPoint& keypoint) {
  return {keypoint.pt.x, keypoint.pt.y};
}

bool isInside(const Eigen::Vector2d& p, const cv::Size& size) {
  return p.x() >= 0.0 && p.y() >= 0.0 && p.x() <= size.width - 1.0 && p.y() <= size.height - 1.0;
}

Eigen::Matrix2d discShape(const cv::KeyPoint& keypoint) {
  const double radius = std::max(0.5, 0.5 * keypoint.size);
  return Eigen::Matrix2d::Identity() / (radius * radius);
}

/// Maps the disc of a keypoint to an ellipse. The homography is linearised at the centre of the
/// disc.
Ellipse mappedDisc(const Eigen::Matrix3d& homography, const cv::KeyPoint& keypoint) {
  const Eigen::Vector3d p = homography * positionOf(keypoint).homogeneous();
  const Eigen::Vector2d centre = p.head<2>() / p.z();
  const Eigen::Matrix2d jacobian =
      (homography.topLeftCorner<2, 2>() - centre * homography.bottomLeftCorner<1, 2>()) / p.z();
  const Eigen::Matrix2d inverse = jacobian.inverse();
  return {centre, inverse.transpose() * discShape(keypoint) * inverse};
}

}  // namespace

double Repeatability::score() const {
  const std::size_t common = std::min(reference_common, target_common);
  return common > 0 ? static_cast<double>(repeated) / static_cast<double>(common) : 0.0;
}

Repeatability detectorRepeatability(const Features& reference, const Features& target,
                                    const Eigen::Matrix3d& truth, double max_overlap_error) {
  const Eigen::Matrix3d inverse = truth.inverse();
  std::vector<Ellipse> mapped;
  for (const cv::KeyPoint& k : reference.keypoints) {
    if (isInside(project(truth, positionOf(k)), target.image_size)) {
      mapped.push_back(mappedDisc(truth, k));
    }
  }
  std::vector<Ellipse> found;
  for (const cv::KeyPoint& k : target.keypoints) {
    if (isInside(project(inverse, positionOf(k)), reference.image_size)) {
      found.push_back({positionOf(k), discShape(k)});
    }
  }

  // Each candidate: overlap error, index of the reference region and index of the target region.
  std::vector<std::tuple<double, std::size_t, std::size_t>> candidates;
  for (std::size_t r = 0; r < mapped.size(); ++r) {
    for (std::size_t t = 0; t < found.size(); ++t) {
      const double distance = (mapped[r].centre - found[t].centre).norm();
      // These two tests reject most pairs quickly: regions that are too far apart or too different
      // in size cannot overlap enough.
      if (distance > 2.0 * kNormalisedRadius) continue;
      const double ratio = mapped[r].area() / found[t].area();
      if (std::min(ratio, 1.0 / ratio) < 1.0 - max_overlap_error) continue;
      // With 8 rows, overlapError() is accurate to 3 %, which is enough to reject most of the other
      // pairs; with 64 rows, it is accurate to 0.1 %.
      if (overlapError(mapped[r], found[t], 8) > max_overlap_error + 0.1) continue;
      const double error = overlapError(mapped[r], found[t], 64);
      if (error <= max_overlap_error) candidates.emplace_back(error, r, t);
    }
  }
  std::sort(candidates.begin(), candidates.end());

  Repeatability result{mapped.size(), found.size(), 0};
  std::vector<bool> reference_used(mapped.size(), false);
  std::vector<bool> target_used(found.size(), false);
  for (const auto& [error, r, t] : candidates) {
    if (reference_used[r] || target_used[t]) continue;
    reference_used[r] = true;
    target_used[t] = true;
    ++result.repeated;
  }
  return result;
}

}  // namespace ktgp_orb::metrics
