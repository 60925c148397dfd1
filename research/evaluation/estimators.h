#pragma once

#include <opencv2/core/types.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::evaluation {

/// Names of the homography estimators of this build:
///   ransac   Fischler & Bolles 1981, OpenCV's
///   msac     Torr & Zisserman 2000: truncated squared error instead of a count
///   mlesac   Torr & Zisserman 2000: likelihood of a Gaussian and a uniform mixture
///   prosac   Chum & Matas 2005, the core's
///   usac     Raguram et al. 2013, OpenCV's USAC_DEFAULT; needs OpenCV 4.6
///   magsac   Barath et al. 2020 (MAGSAC++), OpenCV's USAC_MAGSAC; needs OpenCV 4.6
std::vector<std::string> estimators();

/// `estimator`: one of estimators(). `options` gives the threshold, budget, confidence and seed.
/// The covariance is NaN if the estimator does not give one.
ProsacResult estimateHomography(const std::string& estimator, const PointPairs& pairs,
                                const cv::Size& reference_size, const ProsacOptions& options);

}  // namespace ktgp_orb::evaluation
