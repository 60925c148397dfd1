#pragma once

#include <string>
#include <vector>

#include "evaluation/methods.h"

namespace ktgp_orb::evaluation {

/// OpenCV's own methods for a homography between two images, with their own keypoints or none:
/// SIFT, AKAZE, FLOW and ECC. They have no verdict: every homography that the estimator returns
/// counts as found. `unavailable` gives the reason if this OpenCV lacks a method. `options` has
/// threshold and budget of the estimator (MAGSAC++ unless `estimator` is given).
std::vector<Method> peerMethods(const ProsacOptions& options, const std::string& estimator = "");

}  // namespace ktgp_orb::evaluation
