#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::tools {

/// Estimators of the homography that most pairs agree with.
enum class Estimator {
  ransac,  ///< Fischler & Bolles 1981, OpenCV's
  msac,    ///< Torr & Zisserman 2000: truncated squared error instead of a count
  mlesac,  ///< Torr & Zisserman 2000: likelihood of a Gaussian and a uniform mixture
  prosac,  ///< Chum & Matas 2005, the core's
  usac,    ///< Raguram et al. 2013, OpenCV's USAC_DEFAULT; needs OpenCV 4.6
  magsac,  ///< Barath et al. 2020 (MAGSAC++), OpenCV's USAC_MAGSAC; needs OpenCV 4.6
};

/// All estimators of this build, by their names on the command line.
const std::vector<std::pair<std::string, Estimator>>& estimators();

struct HomographyEstimate {
  bool found = false;
  Eigen::Matrix3d homography = Eigen::Matrix3d::Zero();  ///< reference to target
  std::vector<std::uint8_t> mask;  ///< 1 where its reprojection error is below the threshold
  /// Of its first eight entries (see ProsacResult), if the estimator gives it.
  std::optional<Covariance8> covariance{};
};

/// `options` has threshold, budget, confidence and seed for all of them.
HomographyEstimate estimateHomography(Estimator estimator, const PointPairs& pairs,
                                      const cv::Size& reference_size, const ProsacOptions& options);

}  // namespace ktgp_orb::tools
