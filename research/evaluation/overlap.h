#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>

namespace ktgp_orb::evaluation {

/// Similarity of two images where `homography` (reference to target) overlaps them; needs no ground
/// truth. Zero-mean normalised cross-correlation, from -1 to 1, of the reference's pixels and the
/// target's values at the mapped positions (bilinear). Independent of gain and bias. Both images
/// are 8-bit grey. Empty if fewer than 1 % of the reference's pixels fall into the target, or if
/// one of the two has no contrast there.
std::optional<double> overlapCorrelation(const cv::Mat& reference, const cv::Mat& target,
                                         const Eigen::Matrix3d& homography);

}  // namespace ktgp_orb::evaluation
