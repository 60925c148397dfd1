#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>

namespace ktgp_orb::tools {

/// How alike two images are where `homography` (reference to target) lays one over the other, which
/// needs no ground truth: zero-mean normalised cross-correlation, from -1 to 1, of the reference's
/// pixels and the target's values at their places (bilinear). Gain and bias do not change it. Both
/// images are 8-bit grey. Nothing where fewer than 1 % of the reference's pixels fall into the
/// target, or where one of the two shows no contrast there.
std::optional<double> overlapCorrelation(const cv::Mat& reference, const cv::Mat& target,
                                         const Eigen::Matrix3d& homography);

}  // namespace ktgp_orb::tools
