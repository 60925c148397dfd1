#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "evaluation/dataset.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::evaluation {

/// Annotated correspondences as text, one row `xA yA xB yB` each, px. Throws FileError unless there
/// are at least four rows of four finite numbers.
std::vector<AnnotatedPoint> readPoints(const std::string& file);

/// The homography (reference to target) that is nearest to the points of `file`. Throws FileError
/// if the points determine none, because all of them, or all but one, are on a line.
Eigen::Matrix3d homographyThrough(const std::vector<AnnotatedPoint>& points,
                                  const std::string& file);

/// Mean distance in px of H x_reference from x_target; infinite if H maps a point to infinity.
double meanTransferError(const Eigen::Matrix3d& homography,
                         const std::vector<AnnotatedPoint>& points);

/// Whether the errors of a homography fit its covariance: the largest error of all points is within
/// the 99.9 % bound for this number of points. `sigma`: accuracy of the points, px.
bool isWithinCovariance(const UncertainHomography& estimate,
                        const std::vector<AnnotatedPoint>& points, double sigma);

}  // namespace ktgp_orb::evaluation
