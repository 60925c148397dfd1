#pragma once

#include <optional>
#include <vector>

#include "evaluation/methods.h"

namespace ktgp_orb::tools {

/// OpenCV's own ways from two images to a homography, each with its own keypoints or none: SIFT,
/// AKAZE, FLOW and ECC. Like OpenCV they have no verdict: whatever the estimator returns is called
/// found. A method that this OpenCV has not is listed with the reason in `unavailable`.
/// Threshold and budget of the estimator (MAGSAC++ unless `estimator` is given) are `options`.
std::vector<Method> peerMethods(const ProsacOptions& options,
                                std::optional<Estimator> estimator = std::nullopt);

}  // namespace ktgp_orb::tools
