#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "evaluation/dataset.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::tools {

/// Annotated correspondences as text, `xA yA xB yB` a row, px. Throws FileError unless there are at
/// least four rows of four finite numbers each.
std::vector<AnnotatedPoint> readPoints(const std::string& file);

/// The homography, reference to target, that is nearest to them. Throws std::invalid_argument where
/// they do not determine one.
Eigen::Matrix3d homographyThrough(const std::vector<AnnotatedPoint>& points);

/// Mean distance in px of H x_reference from x_target; infinite where H sends one to infinity.
double meanTransferError(const Eigen::Matrix3d& homography,
                         const std::vector<AnnotatedPoint>& points);

/// Whether the errors of a homography are as large as its covariance says: the largest of all
/// points within the 99.9 % bound for so many. `sigma`: how exact the points are, px.
bool isWithinCovariance(const UncertainHomography& estimate,
                        const std::vector<AnnotatedPoint>& points, double sigma);

}  // namespace ktgp_orb::tools
