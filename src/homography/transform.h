#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// Inline version of reprojectionError() for inner loops, where a function call for each pair would
/// take longer than the arithmetic.
inline double errorOf(const Eigen::Matrix3d& homography, const Eigen::Vector2d& reference,
                      const Eigen::Vector2d& target) {
  const Eigen::Vector3d p = homography * reference.homogeneous();
  return (p.hnormalized() - target).norm();
}

using FourPoints = std::array<Eigen::Vector2d, 4>;

/// Computes the homography that maps four reference points to four target points, in closed form.
/// Returns false, without solving, if the homography cannot be the view of a plane from one side.
/// This is the case if three of the points form a flat triangle (its doubled area is below the
/// minimum, because points are collinear or equal), or a triangle with opposite orientations in the
/// two images. On success, H x has a positive third coordinate at the four points.
bool solveFourPoints(const FourPoints& reference, const FourPoints& target,
                     double min_reference_area, double min_target_area,
                     Eigen::Matrix3d& homography);

Eigen::Vector2d project(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point);

/// Jacobian of the mapped point with respect to H's first eight entries, row by row; H(2,2) is
/// fixed.
Eigen::Matrix<double, 2, 8> jacobianByEntries(const Eigen::Matrix3d& homography,
                                              const Eigen::Vector2d& point);

/// Jacobian of the mapped point with respect to the point.
Eigen::Matrix2d jacobianByPoint(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point);

/// Scales H to H(2,2) = 1. If H(2,2) is too close to 0, scales H to norm 1 and returns false.
bool scaleLastToOne(Eigen::Matrix3d& homography);

/// Corners of the image, px. If the size is empty, returns the corners of the bounding box of the
/// points.
FourPoints imageCorners(const cv::Size& size, const std::vector<Eigen::Vector2d>& points);

/// Returns true if H shows the plane from one side over the whole image: H mirrors nothing (det H >
/// 0 with a positive third coordinate), and its horizon, the line that is mapped to infinity, does
/// not come near any corner and therefore does not cross the image.
bool keepsPlaneInView(const Eigen::Matrix3d& homography, const FourPoints& corners);

/// Returns the homography from an image to the resized image, px; the centre of the first pixel is
/// (0, 0) in both.
Eigen::Matrix3d resizing(const cv::Size& from, const cv::Size& to);

/// If an image of `size` is warped by H, returns the share of the original area that the warped
/// image covers, 0..1.
double overlap(const Eigen::Matrix3d& homography, const cv::Size& size);

/// Uncertainty of H at the corners of the image. `target`: largest standard deviation of a corner
/// mapped to the target. `reference`: largest standard deviation of a target point mapped back to a
/// corner of the reference.
struct CornerDeviation {
  double target = 0.0;
  double reference = 0.0;
};

/// Propagates the covariance of H's first eight entries, with H(2,2) = 1, to the corners. The
/// deviation of a corner is the square root of the trace of its covariance, in the units of H;
/// infinite if it is undefined.
CornerDeviation cornerDeviation(const Eigen::Matrix3d& homography,
                                const Eigen::Matrix<double, 8, 8>& covariance,
                                const FourPoints& corners);

/// Returns the homography that applies `first` and then `second`, with its covariance to first
/// order. The noise of the two homographies is independent, so the covariances of the noise add up.
/// A shared error occurs in both, so its standard deviations add up: two equal shared errors give
/// twice the deviation and four times the variance.
UncertainHomography chained(const UncertainHomography& second, const UncertainHomography& first);

/// Calls visit(name, values...) for each scalar field of an answer (UncertainHomography). `name`:
/// name of the field. `values`: value of the field in each of the `holders`, which are answers or
/// messages; there may be none.
template <typename Visit, typename... Holders>
void visitNumbers(Visit visit, Holders&... holders) {
  visit("plane_deviation", holders.plane_deviation...);
}

/// Like visitNumbers(), but visits all fields that messages and files contain.
template <typename Visit, typename... Holders>
void visitAnswer(Visit visit, Holders&... holders) {
  visit("homography", holders.homography...);
  visit("covariance", holders.covariance...);
  visitNumbers(visit, holders...);
}

}  // namespace ktgp_orb::homography
