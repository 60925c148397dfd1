#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::homography {

/// reprojectionError() inline, for the core's loops, where a call per pair would take longer than
/// the arithmetic.
inline double errorOf(const Eigen::Matrix3d& homography, const Eigen::Vector2d& reference,
                      const Eigen::Vector2d& target) {
  const Eigen::Vector3d p = homography * reference.homogeneous();
  return (p.hnormalized() - target).norm();
}

using FourPoints = std::array<Eigen::Vector2d, 4>;

/// The homography that maps four reference points to four target points, in closed form.
/// Returns false, before solving, where it cannot be the view of a plane from one side: a triangle
/// of three of the points is flat (doubled area below `min_area`: collinear or duplicate points) or
/// has opposite orientations in the two images. On success H x has a positive third coordinate at
/// the four points.
bool solveFourPoints(const FourPoints& reference, const FourPoints& target,
                     double min_reference_area, double min_target_area,
                     Eigen::Matrix3d& homography);

Eigen::Vector2d project(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point);

/// Derivative of the mapped point by H's first eight entries, row by row, with H(2,2) fixed.
Eigen::Matrix<double, 2, 8> jacobianByEntries(const Eigen::Matrix3d& homography,
                                              const Eigen::Vector2d& point);

/// Derivative of the mapped point by the point.
Eigen::Matrix2d jacobianByPoint(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point);

/// Scales H to H(2,2) = 1, or to length 1 and returns false if that is not possible.
bool scaleLastToOne(Eigen::Matrix3d& homography);

/// Corners of the image, in pixels; of the points' bounding box where the size is empty.
FourPoints imageCorners(const cv::Size& size, const std::vector<Eigen::Vector2d>& points);

/// True if H can show the plane over the whole image from one side: it mirrors nothing (det H >
/// 0 with a positive third coordinate), and its horizon, the line that is mapped to infinity, stays
/// clear of the corners and so of the image.
bool keepsPlaneInView(const Eigen::Matrix3d& homography, const FourPoints& corners);

/// An image -> the same image resized, px; the centre of the first pixel is at 0, 0 in both.
Eigen::Matrix3d resizing(const cv::Size& from, const cv::Size& to);

/// Share of an image of `size` that the same image warped by H covers, 0..1.
double overlap(const Eigen::Matrix3d& homography, const cv::Size& size);

/// Uncertainty of H: the largest standard deviation of the mapped corners in the target, and of the
/// corners mapped back in the reference.
struct CornerDeviation {
  double target = 0.0;
  double reference = 0.0;
};

/// The root of the trace of the covariance propagated from that of H's first eight entries, with
/// H(2,2) = 1, in the units of H. Infinite if undefined.
CornerDeviation cornerDeviation(const Eigen::Matrix3d& homography,
                                const Eigen::Matrix<double, 8, 8>& covariance,
                                const FourPoints& corners);

/// `first`, then `second`: the product, with its covariance to first order. Covariances of noise
/// add. For the shared parts the deviations add: the same error twice has twice the deviation and
/// four times the variance.
UncertainHomography chained(const UncertainHomography& second, const UncertainHomography& first);

/// Calls `visit` with the name of each number of an answer (UncertainHomography), and with the
/// members of that name of `holders`: answers, messages, or none.
template <typename Visit, typename... Holders>
void visitNumbers(Visit visit, Holders&... holders) {
  visit("plane_deviation", holders.plane_deviation...);
}

/// The same for all fields that messages and files have.
template <typename Visit, typename... Holders>
void visitAnswer(Visit visit, Holders&... holders) {
  visit("homography", holders.homography...);
  visit("covariance", holders.covariance...);
  visitNumbers(visit, holders...);
}

}  // namespace ktgp_orb::homography
