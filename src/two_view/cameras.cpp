#include "two_view/cameras.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "homography/transform.h"
#include "two_view/epipolar.h"
#include "util/camera_check.h"
#include "util/constants.h"
#include "util/format.h"
#include "util/options_check.h"

namespace ktgp_orb::two_view {
namespace {

void requireCamera(const Eigen::Matrix3d& k, const cv::Size& size, const std::string& whose) {
  const std::string name = "the K of the " + whose + " camera";
  util::requireK(name, k, size);
  constexpr double kMostRatio = 4.0;  // largest ratio of the sides of a pixel
  util::requireInRange("fx / fy of " + name, k(0, 0) / k(1, 1), 1.0 / kMostRatio, kMostRatio);
  util::requirePrincipalPoint(name, k, size);
}

}  // namespace

std::optional<Cameras> camerasOf(const TwoViewInput& input) {
  if (!input.reference_camera) {
    if (!input.target_camera) return std::nullopt;
    throw std::invalid_argument(
        "there is a K of the target camera and none of the reference camera; expected both or "
        "neither");
  }
  const cv::Size& size = input.reference_size;
  const bool differ = !size.empty() && !input.target_size.empty() && size != input.target_size;
  if (!input.target_camera && differ) {
    throw std::invalid_argument("the target image has " + util::text(input.target_size) +
                                " px and the reference image " + util::text(size) +
                                " px, so they cannot share a K; expected a K of each");
  }
  const Cameras cameras{*input.reference_camera,
                        input.target_camera.value_or(*input.reference_camera)};
  requireCamera(cameras.reference, input.reference_size, "reference");
  requireCamera(cameras.target, input.target_size, "target");
  return cameras;
}

bool Cameras::seeInFront(const RelativePose& motion, const Eigen::Vector2d& x,
                         const Eigen::Vector2d& u, double max_error) const {
  if (inFront(motion, referenceRay(x), targetRay(u))) return true;
  return homography::errorOf(homographyOf(motion.rotation), x, u) < max_error;
}

double distanceToLine(const Eigen::Matrix3d& f, const Eigen::Vector2d& x,
                      const Eigen::Vector2d& u) {
  const Eigen::Vector3d line = f * x.homogeneous();
  return std::abs(line.dot(u.homogeneous())) / std::max(line.head<2>().norm(), 1e-30);
}

double sampson(const Eigen::Matrix3d& f, const Eigen::Vector2d& x, const Eigen::Vector2d& u) {
  const Eigen::Vector3d line = f * x.homogeneous();
  const Eigen::Vector3d back = f.transpose() * u.homogeneous();
  const double length2 = line.head<2>().squaredNorm() + back.head<2>().squaredNorm();
  return std::abs(line.dot(u.homogeneous())) / std::sqrt(std::max(length2, 1e-60));
}

void label(const PointPairs& pairs, const std::optional<Cameras>& cameras, double max_error,
           TwoView& view) {
  const bool epipolar = view.geometry == Geometry::epipolar;
  const double limit = epipolar ? kSampsonShare * max_error : max_error;
  const RelativePose& motion = view.pose;
  view.mask.assign(pairs.size(), 0);
  view.inliers = 0;
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Eigen::Vector2d& x = pairs.reference[i];
    const Eigen::Vector2d& u = pairs.target[i];
    const double error =
        epipolar ? sampson(view.fundamental, x, u) : homography::errorOf(view.homography, x, u);
    if (!(error < limit)) continue;
    if (epipolar && cameras && !cameras->seeInFront(motion, x, u, max_error)) continue;
    view.mask[i] = 1;
    ++view.inliers;
    sum += error * error;
  }
  view.rmse = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(view.inliers, 1)));
}

double parallaxOf(const PointPairs& pairs, const Cameras& cameras, const TwoView& view,
                  std::vector<double>& angles) {
  angles.clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (view.mask[i] == 0) continue;
    const Eigen::Vector3d a = view.pose.rotation * cameras.referenceRay(pairs.reference[i]);
    const Eigen::Vector3d b = cameras.targetRay(pairs.target[i]);
    angles.push_back(std::atan2(a.cross(b).norm(), a.dot(b)));
  }
  if (angles.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2);
  std::nth_element(angles.begin(), middle, angles.end());
  return *middle * 180.0 / util::kPi;
}

Covariance6 poseCovariance(const Eigen::Matrix<double, 5, 5>& of_step, const Eigen::Vector3d& t) {
  Eigen::Matrix<double, 6, 5> spread = Eigen::Matrix<double, 6, 5>::Zero();
  spread.topRightCorner<3, 2>() = across(t);
  spread.bottomLeftCorner<3, 3>().setIdentity();
  return spread * of_step * spread.transpose();
}

Eigen::Matrix<double, 6, 1> stepBetween(const RelativePose& from, const RelativePose& to) {
  const Eigen::Vector3d& t = from.translation;
  const Eigen::AngleAxisd turn(to.rotation * from.rotation.transpose());
  Eigen::Vector3d sideways = to.translation - t * t.dot(to.translation);
  const double angle = std::atan2(sideways.norm(), t.dot(to.translation));
  sideways = sideways.norm() > 1e-9 ? Eigen::Vector3d(sideways.normalized())
                                    : Eigen::Vector3d(across(t).col(0));
  Eigen::Matrix<double, 6, 1> step;
  step << angle * sideways, turn.angle() * turn.axis();
  return step;
}

namespace {

constexpr double kLeastError = 0.05;  // px; standard deviation of a coordinate, at least

/// Standard deviations of one coordinate of a point, px.
struct PointErrors {
  double aligned;
  double other;
};

/// Measures the errors of the aligned inliers and of the others, by the median of their Sampson
/// distances. If there are few inliers of a kind, their error follows from that of the other kind.
PointErrors errorsOf(const TwoViewMatches& matches) {
  constexpr std::size_t kFew = 10;
  constexpr double kRatio = 3.4;      // measured over 20 sets of scenes; see matches.cpp
  constexpr double kNormal = 1.4826;  // standard deviation / median of the absolute values
  std::vector<double> distances;
  const auto measured = [&](bool aligned) {
    distances.clear();
    for (std::size_t i = 0; i < matches.pairs.size(); ++i) {
      if (matches.view.mask[i] == 0 || (matches.aligned[i] != 0) != aligned) continue;
      distances.push_back(
          sampson(matches.view.fundamental, matches.pairs.reference[i], matches.pairs.target[i]));
    }
    if (distances.size() < kFew) return 0.0;
    const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
    std::nth_element(distances.begin(), middle, distances.end());
    return std::max(kNormal * *middle, kLeastError);
  };
  const PointErrors errors{measured(true), measured(false)};
  const double all = std::max(matches.view.rmse, kLeastError);
  if (errors.aligned == 0.0 && errors.other == 0.0) return {all, all};
  if (errors.aligned == 0.0) return {errors.other / kRatio, errors.other};
  if (errors.other == 0.0) return {errors.aligned, kRatio * errors.aligned};
  return errors;
}

/// `error_of(i)`: standard deviation of one coordinate of the points of pair i, px.
template <typename ErrorOf>
void triangulateEach(const PointPairs& pairs, const TwoViewInput& input, const TwoView& geometry,
                     const ErrorOf& error_of, std::vector<ScenePoint>& points) {
  constexpr double kClear = 2.0;  // minimum parallax, as a multiple of the error; less may be noise
  const std::optional<Cameras> cameras = camerasOf(input);
  if (!cameras || geometry.status != Status::ok || geometry.pose.translation.isZero(0.0)) return;
  if (geometry.mask.size() != pairs.size()) {
    throw std::invalid_argument("the geometry is of " + std::to_string(geometry.mask.size()) +
                                " pairs, and there are " + std::to_string(pairs.size()));
  }
  const Eigen::Matrix3d turn = geometry.pose.rotation;
  const Eigen::Vector3d t = geometry.pose.translation;
  const Eigen::Matrix3d far = cameras->homographyOf(turn);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (geometry.mask[i] == 0) continue;
    const double error = error_of(i);
    if (homography::errorOf(far, pairs.reference[i], pairs.target[i]) < kClear * error) continue;
    // In homogeneous coordinates, the target point is K' (R q + z t), where K' is the K of the
    // target camera, R and t are the motion, q is the ray of the reference point, and z is the
    // inverse depth. Multiplying by the third coordinate makes the equations linear in z.
    const Eigen::Vector3d q = cameras->referenceRay(pairs.reference[i]);
    const Eigen::Vector3d a = cameras->target * turn * q;
    const Eigen::Vector3d b = cameras->target * t;
    const Eigen::Vector2d u = pairs.target[i];
    const Eigen::Vector2d slope = b.head<2>() - u * b.z();
    const Eigen::Vector2d value = u * a.z() - a.head<2>();
    const double inverse_depth = slope.dot(value) / slope.squaredNorm();
    const double depth = 1.0 / inverse_depth;
    if (!(inverse_depth > 1e-9) || !((a + inverse_depth * b).z() > 0.0)) continue;
    ScenePoint point;
    point.pair = i;
    point.position = depth * q;
    // `by_inverse`: how far the target point moves per unit of inverse depth, px. `by_reference`:
    // how far it moves per px of the reference point. The standard deviation of the depth follows
    // from them. `across`: standard deviation across the ray.
    const Eigen::Vector3d seen = a + inverse_depth * b;
    const double by_inverse = slope.norm() / seen.z();
    const double by_reference = cameras->target(0, 0) / (cameras->reference(0, 0) * seen.z());
    const double depth_deviation =
        std::hypot(1.0, by_reference) * error / by_inverse * depth * depth;
    const double across = error * depth / cameras->reference(0, 0);
    point.covariance = depth_deviation * depth_deviation * q * q.transpose();
    point.covariance(0, 0) += across * across;
    point.covariance(1, 1) += across * across;
    points.push_back(point);
  }
}

}  // namespace
}  // namespace ktgp_orb::two_view

namespace ktgp_orb {

void triangulate(const PointPairs& pairs, const TwoViewInput& input, const TwoView& geometry,
                 std::vector<ScenePoint>& points) {
  points.clear();
  const double scale = geometry.scale > 0.0 ? geometry.scale : geometry.rmse;
  const double error = std::max(scale, two_view::kLeastError);
  two_view::triangulateEach(
      pairs, input, geometry, [&](std::size_t /*i*/) { return error; }, points);
}

void triangulate(const TwoViewMatches& matches, const TwoViewInput& input,
                 std::vector<ScenePoint>& points) {
  points.clear();
  if (matches.view.status != Status::ok) return;
  const two_view::PointErrors errors = two_view::errorsOf(matches);
  const auto error_of = [&](std::size_t i) {
    return matches.aligned[i] != 0 ? errors.aligned : errors.other;
  };
  two_view::triangulateEach(matches.pairs, input, matches.view, error_of, points);
}

}  // namespace ktgp_orb
