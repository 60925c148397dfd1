#include "evaluation/warps.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "evaluation/rendering.h"
#include "util/constants.h"
#include "util/random.h"

namespace ktgp_orb::evaluation {
namespace {

using util::Random;

constexpr double kDegree = util::kPi / 180.0;
constexpr double kFocalLength = kWarpWidth;  // px; the reference view is 53 degrees wide
constexpr double kShown = 0.85;              // share of the picture in the reference view
const Eigen::Vector2d kCentre(0.5 * (kWarpWidth - 1), 0.5 * (kWarpHeight - 1));

double uniform(Random& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random.next() >> 11) * 0x1p-53;
}

/// Uniform in [-most, most] without values closer to zero than `least`.
double keptAway(double value, double least, double most) {
  return least > 0.0 ? value * (1.0 - least / most) + std::copysign(least, value) : value;
}

double logUniform(Random& random, double low, double high) {
  return std::exp(uniform(random, std::log(low), std::log(high)));
}

Eigen::Matrix3d translation(const Eigen::Vector2d& t) {
  Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
  m.topRightCorner<2, 1>() = t;
  return m;
}

/// The reference camera looks straight at a plane; the target camera sees it rotated, tilted and
/// with another focal length. The random values are drawn in the order of the declarations.
Eigen::Matrix3d drawHomography(const WarpLimits& limits, Random& random) {
  const double rotation = uniform(random, -limits.rotation, limits.rotation) * kDegree;
  const double log_zoom = uniform(random, std::log(1.0 / limits.zoom), std::log(limits.zoom));
  const double zoom =
      std::exp(keptAway(log_zoom, std::log(limits.least_zoom), std::log(limits.zoom)));
  const double any_tilt = uniform(random, -limits.tilt, limits.tilt);
  const double tilt = keptAway(any_tilt, limits.least_tilt, limits.tilt) * kDegree;
  const double axis = uniform(random, 0.0, util::kPi);
  const double shift_x = uniform(random, -limits.shift, limits.shift);
  const double shift_y = uniform(random, -limits.shift, limits.shift);

  const Eigen::Matrix3d turned =
      (Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(axis), std::sin(axis), 0.0)) *
       Eigen::AngleAxisd(rotation, Eigen::Vector3d::UnitZ()))
          .toRotationMatrix();
  Eigen::Matrix3d plane;  // axes and origin of the plane, px, in the target camera's frame
  plane << turned.col(0), turned.col(1), Eigen::Vector3d(0.0, 0.0, kFocalLength);
  const double focal_length = kFocalLength * zoom;
  const Eigen::Matrix3d camera = Eigen::Vector3d(focal_length, focal_length, 1.0).asDiagonal();
  const Eigen::Vector2d shift(shift_x, shift_y);
  const Eigen::Matrix3d h = translation(kCentre + shift) * camera * plane * translation(-kCentre);
  return h / h(2, 2);
}

Degradation drawDegradation(const WarpLimits& limits, Random& random) {
  Degradation d;
  d.blur = uniform(random, 0.3, 1.0);
  d.gamma = logUniform(random, 1.0 / limits.gamma, limits.gamma);
  d.gain = uniform(random, 1.0 - limits.gain, 1.0 + limits.gain);
  d.noise = uniform(random, 1.0, 5.0);
  d.seed = random.next();
  return d;
}

/// `view`: CV_32F.
void degrade(const Degradation& d, cv::Mat& view) {
  cv::GaussianBlur(view, view, {}, d.blur);
  view = cv::max(view, 0.0F);
  cv::pow(view / 255.0, d.gamma, view);
  view *= 255.0 * d.gain;
  cv::Mat noise(view.size(), CV_32F);
  cv::RNG(d.seed).fill(noise, cv::RNG::NORMAL, 0.0, d.noise);
  view += noise;
}

/// Maps the reference view to the middle of the picture: to kShown of the largest part with the
/// proportions of the view.
Eigen::Matrix3d pictureFromReference(const cv::Size& picture) {
  const double scale =
      kShown * std::min(picture.width / double{kWarpWidth}, picture.height / double{kWarpHeight});
  const Eigen::Vector2d middle(0.5 * (picture.width - 1), 0.5 * (picture.height - 1));
  const Eigen::Matrix3d scaling = Eigen::Vector3d(scale, scale, 1.0).asDiagonal();
  return translation(middle) * scaling * translation(-kCentre);
}

cv::Mat toGrey(const cv::Mat& view) {
  cv::Mat grey;
  view.convertTo(grey, CV_8U);
  return grey;
}

}  // namespace

std::optional<WarpLimits> warpLimits(const std::string& name) {
  if (name == "tiny") return WarpLimits{0.2, 1.002, 0.1, 1.5};  // motion of a slow camera
  if (name == "small") return WarpLimits{2.0, 1.04, 2.0, 20.0};
  if (name == "medium") return WarpLimits{25.0, 1.4, 20.0, 60.0};
  if (name == "large") return WarpLimits{180.0, 2.2, 40.0, 80.0};
  // Hard in every respect: tilt, zoom and light.
  if (name == "extreme") return WarpLimits{180.0, 4.0, 70.0, 80.0, 2.0, 0.4, 2.0, 50.0, true};
  return std::nullopt;
}

Warp drawWarp(const WarpLimits& limits, int index, std::uint64_t seed) {
  // Neighbouring seeds of SplitMix64 give the same numbers, shifted, so the seed is drawn, too.
  Random random(Random(seed).next() ^ Random(static_cast<std::uint64_t>(index)).next());
  Warp warp;
  warp.homography = drawHomography(limits, random);
  if (limits.always_degraded || index % 2 == 1) warp.degradation = drawDegradation(limits, random);
  return warp;
}

WarpedImages renderWarp(const cv::Mat& picture, const Warp& warp) {
  cv::Mat source;
  picture.convertTo(source, CV_32F);
  const cv::Size size(kWarpWidth, kWarpHeight);
  const Eigen::Matrix3d picture_from_reference = pictureFromReference(picture.size());
  const Eigen::Matrix3d picture_from_target = picture_from_reference * warp.homography.inverse();
  cv::Mat target = renderView(source, picture_from_target, size);
  if (warp.degradation) degrade(*warp.degradation, target);
  return {toGrey(renderView(source, picture_from_reference, size)), toGrey(target)};
}

}  // namespace ktgp_orb::evaluation
