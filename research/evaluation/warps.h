#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

namespace ktgp_orb::evaluation {

/// Limits for the motion of the camera between the two views of a warp. Every value is drawn
/// uniformly from -limit to limit (the zoom on a logarithmic scale, from 1/zoom to zoom).
struct WarpLimits {
  double rotation = 0.0;         ///< about the optical axis, degrees
  double zoom = 1.0;             ///< ratio of the focal lengths
  double tilt = 0.0;             ///< largest tilt of the plane, about any axis within it, degrees
  double shift = 0.0;            ///< largest shift of the image centre along x and along y, px
  double gamma = 1.3;            ///< exponent of a degraded target: 1/gamma to gamma, log scale
  double gain = 0.2;             ///< gain of a degraded target: 1 - gain to 1 + gain
  double least_zoom = 1.0;       ///< the zoom is at least this or at most its inverse
  double least_tilt = 0.0;       ///< the tilt is at least this in either direction, degrees
  bool always_degraded = false;  ///< every target is degraded, not only every second
};

/// "tiny", "small", "medium", "large" or "extreme"; empty for another name.
std::optional<WarpLimits> warpLimits(const std::string& name);

constexpr int kWarpWidth = 640;
constexpr int kWarpHeight = 480;

/// Changes of light between the picture and the target image: Gaussian blur, gamma, gain, noise, in
/// this order.
struct Degradation {
  double blur = 0.0;   ///< sigma, px
  double gamma = 1.0;  ///< exponent of the grey value over 255
  double gain = 1.0;
  double noise = 0.0;  ///< standard deviation, grey values
  std::uint64_t seed = 0;
};

/// The parameters of a pair of views of one picture; renderWarp makes the images.
struct Warp {
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();  ///< reference to target, px; exact
  std::optional<Degradation> degradation;                    ///< degradation of the target image
};

/// Warp number `index` of a series. The same arguments give the same warp. Even numbers are clean
/// and odd numbers are degraded, unless the limits degrade all.
Warp drawWarp(const WarpLimits& limits, int index, std::uint64_t seed);

struct WarpedImages {
  cv::Mat reference;  ///< 8-bit grey, kWarpWidth x kWarpHeight
  cv::Mat target;     ///< 8-bit grey, same size
};

/// Renders both views of `picture` (8-bit grey, any size) with antialiasing. The reference view
/// shows the middle 85 % of the largest 4:3 part of the picture, so that a small warp stays inside
/// the picture. Parts outside the picture are black.
WarpedImages renderWarp(const cv::Mat& picture, const Warp& warp);

}  // namespace ktgp_orb::evaluation
