#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>

namespace ktgp_orb::evaluation {

/// Similarity of two images in the part that `homography` (reference to target) overlaps; needs no
/// ground truth. This is the zero-mean normalised cross-correlation, from -1 to 1, of the
/// reference's pixels and the bilinear values of the target at the mapped positions. It does not
/// depend on gain and bias. Both images are 8-bit grey. Empty if fewer than 1 % of the reference's
/// pixels fall into the target, or if one of the images has no contrast there.
std::optional<double> overlapCorrelation(const cv::Mat& reference, const cv::Mat& target,
                                         const Eigen::Matrix3d& homography);

}  // namespace ktgp_orb::evaluation
