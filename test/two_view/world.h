#pragma once

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/two_view.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::two_view {

inline constexpr double kDegree = 0.017453292519943295;  // rad
using test::Numbers;

inline const cv::Size kSize(640, 480);

inline Eigen::Matrix3d camera() {
  return test::cameraMatrix(500.0, 505.0);
}

/// Returns the position of the point `x` in an image with a radial distortion of `at_corners` px.
inline Eigen::Vector2d distorted(const Eigen::Vector2d& x, double at_corners) {
  const Eigen::Vector2d centre = camera().topRightCorner<2, 1>();
  const Eigen::Vector2d off = (x - centre) / centre.norm();
  return x + at_corners * off.squaredNorm() * off;
}

inline Eigen::Vector3d randomVector(Numbers& numbers) {
  const double x = numbers.normal();
  const double y = numbers.normal();
  return {x, y, numbers.normal()};
}

/// Rotation by up to `most` radians.
inline Eigen::Matrix3d randomRotation(double most, Numbers& numbers) {
  const Eigen::Vector3d axis = randomVector(numbers).normalized();
  return Eigen::AngleAxisd(numbers.uniform(0.0, most), axis).toRotationMatrix();
}

enum class Shape { plane, relief, two_planes, turn, still, depth, forward, far };

/// How a camera moves from the reference to the target, in the units of the depths.
struct Travel {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
  /// Readout time of an image as a share of the time between the images; 0: a global shutter. The
  /// camera moves at a constant speed, and the pose is that of the middle row.
  double readout = 0.0;

  Travel(const Eigen::Matrix3d& by, const Eigen::Vector3d& along, double readout_ = 0.0)
      : rotation(by), translation(along), readout(readout_) {}

  /// Any motion over a scene of the shape.
  Travel(Shape shape, Numbers& numbers)
      : rotation(shape == Shape::still ? Eigen::Matrix3d::Identity()
                                       : randomRotation(0.15, numbers)),
        translation(randomVector(numbers).normalized() * numbers.uniform(0.4, 0.8)) {
    if (shape == Shape::turn || shape == Shape::still) translation.setZero();
    if (shape == Shape::forward) {
      rotation = randomRotation(0.03, numbers);
      const double x = 0.03 * numbers.normal();
      translation = Eigen::Vector3d(x, 0.03 * numbers.normal(), -1.0);
    }
  }

  /// Where the camera sees a point of the reference's frame after the share `time` of the travel.
  Eigen::Vector2d seen(const Eigen::Vector3d& point, double time) const {
    constexpr int kRounds = 6;
    const Eigen::AngleAxisd turn(rotation);
    double at = time;
    Eigen::Vector2d u;
    for (int round = 0; round < kRounds; ++round) {
      const Eigen::AngleAxisd part(at * turn.angle(), turn.axis());
      u = (camera() * (part * point + at * translation)).hnormalized();
      if (readout == 0.0) break;
      at = time + readout * (u.y() - 0.5 * (kSize.height - 1)) / kSize.height;
    }
    return u;
  }
};

/// A drawn scene and what is true of it.
struct World {
  Shape shape = Shape::depth;
  std::size_t right = 200;  ///< pairs of the scene
  std::size_t wrong = 60;   ///< pairs of unrelated points
  double noise = 0.5;       ///< px, in both images
  RelativePose pose;
  PointPairs pairs;  ///< the right ones first

  World(Shape shape_, Numbers& numbers, std::size_t right_ = 200, std::size_t wrong_ = 60,
        double noise_ = 0.5)
      : World(shape_, Travel(shape_, numbers), numbers, right_, wrong_, noise_) {}

  World(Shape shape_, const Travel& travel, Numbers& numbers, std::size_t right_ = 200,
        std::size_t wrong_ = 60, double noise_ = 0.5)
      : shape(shape_), right(right_), wrong(wrong_), noise(noise_) {
    const Eigen::Vector3d& t = travel.translation;
    pose.rotation = travel.rotation;
    pose.translation = t.isZero(0.0) ? t : Eigen::Vector3d(t.normalized());
    const Eigen::Vector3d tilt(0.3 * numbers.normal(), 0.3 * numbers.normal(), 1.0);
    while (pairs.size() < right) {
      Eigen::Vector2d x = numbers.pointIn(kSize);
      const Eigen::Vector3d q = camera().inverse() * x.homogeneous();
      const Eigen::Vector3d p = q * depthOf(x, q, tilt, numbers);
      if ((pose.rotation * p + t).z() < 0.2 || p.z() < 0.2) continue;
      const Eigen::Vector2d u = travel.seen(p, 1.0);
      if (!test::isInside(u, kSize)) continue;
      if (travel.readout != 0.0) x = travel.seen(p, 0.0);
      const Eigen::Vector2d first(noise * numbers.normal(), noise * numbers.normal());
      const Eigen::Vector2d second(noise * numbers.normal(), noise * numbers.normal());
      pairs.add(x + first, u + second, test::qualityOf(true, test::Order::good, numbers));
    }
    for (std::size_t i = 0; i < wrong; ++i) {
      const Eigen::Vector2d x = numbers.pointIn(kSize);
      pairs.add(x, numbers.pointIn(kSize), test::qualityOf(false, test::Order::good, numbers));
    }
  }

  TwoViewInput input(bool calibrated = true) const {
    TwoViewInput input;
    if (calibrated) input.reference_camera = camera();
    input.reference_size = input.target_size = kSize;
    return input;
  }

  double turnError(const RelativePose& found) const {
    return Eigen::AngleAxisd(found.rotation * pose.rotation.transpose()).angle();
  }
  double directionError(const RelativePose& found) const {
    return std::acos(std::clamp(found.translation.dot(pose.translation), -1.0, 1.0));
  }
  double kept(const TwoView& result) const {
    std::size_t count = 0;
    for (std::size_t i = 0; i < right; ++i) count += result.mask[i];
    return static_cast<double>(count) / static_cast<double>(right);
  }

 private:
  double depthOf(const Eigen::Vector2d& x, const Eigen::Vector3d& q, const Eigen::Vector3d& tilt,
                 Numbers& numbers) const {
    const double flat = 4.0 / q.dot(tilt);
    switch (shape) {
      case Shape::plane:
        return flat;
      case Shape::relief:
        return flat * numbers.uniform(0.95, 1.05);
      case Shape::two_planes:
        return x.x() < 320.0 ? flat : 7.0 / (q.z() - 0.3 * q.y());
      case Shape::far:
        return numbers.uniform(3.0, 12.0);
      default:
        return numbers.uniform(2.0, 12.0);
    }
  }
};

/// Over the plane z = 4 + tilt with some pairs off it.
inline World worldOverAPlane(double share_off, Numbers& numbers) {
  World world(Shape::plane, numbers, 300, 20, 0.2);
  World off(Shape::depth, numbers, 1, 0, 0.2);
  const auto count = static_cast<std::size_t>(share_off * static_cast<double>(world.right));
  const Eigen::Matrix3d k = camera();
  for (std::size_t i = 0; i < count;) {
    const Eigen::Vector2d x = numbers.pointIn(kSize);
    const Eigen::Vector3d p = numbers.uniform(2.0, 3.2) * (k.inverse() * x.homogeneous());
    const Eigen::Vector3d moved = world.pose.rotation * p + 0.6 * world.pose.translation;
    const Eigen::Vector2d u = (k * moved).hnormalized();
    if (!(moved.z() > 0.2) || !test::isInside(u, kSize)) continue;
    world.pairs.reference[i] = x + 0.2 * Eigen::Vector2d(numbers.normal(), numbers.normal());
    world.pairs.target[i] = u + 0.2 * Eigen::Vector2d(numbers.normal(), numbers.normal());
    ++i;
  }
  return world;
}

/// A tenth to seven tenths of the pairs are one period off, as on a texture that repeats itself.
inline World worldThatRepeats(Shape shape, Numbers& numbers) {
  World world(shape, numbers, 400, 80, 0.2);
  const double share = numbers.uniform(0.1, 0.7);
  const Eigen::Vector2d period(numbers.uniform(20.0, 120.0), 0.0);
  for (std::size_t i = 0; i < world.right; ++i) {
    if (numbers.uniform(0.0, 1.0) < share) world.pairs.target[i] += period;
  }
  return world;
}

/// The camera turns by 8 to 35 degrees.
inline World worldOfAWideTurn(Shape shape, Numbers& numbers) {
  Travel travel(shape, numbers);
  travel.rotation = Eigen::AngleAxisd(numbers.uniform(8.0, 35.0) * kDegree,
                                      Eigen::AngleAxisd(travel.rotation).axis())
                        .toRotationMatrix();
  return {shape, travel, numbers, 400, 80, 0.2};
}

/// The median parallax is 0.05 to 1 degrees.
inline World worldOfLittleParallax(Shape shape, Numbers& numbers) {
  Travel travel(shape, numbers);
  travel.translation = numbers.uniform(0.005, 0.12) * travel.translation.normalized();
  return {shape, travel, numbers, 400, 80, 0.2};
}

/// Estimates the motion with focal length, zoom, principal point and distortion as wrong as
/// `errors` expects. Patches of the unrelated points could not be aligned.
inline void estimateWithErrors(World& world, const SharedErrors& errors, Numbers& numbers,
                               TwoViewEstimator& estimator, TwoView& found) {
  constexpr double kUnaligned = 12.0;  // relative deviation, as in TwoViewMatcher
  const Eigen::Vector2d centre = camera().topRightCorner<2, 1>();
  const double zoom = 1.0 + errors.zoom * numbers.normal();
  for (Eigen::Vector2d& u : world.pairs.target) u = centre + zoom * (u - centre);
  const double distortion = errors.distortion * numbers.normal();
  for (auto* points : {&world.pairs.reference, &world.pairs.target}) {
    for (Eigen::Vector2d& x : *points) x = distorted(x, distortion);
  }
  TwoViewInput input = world.input();
  Eigen::Matrix3d& k = *input.reference_camera;
  k(0, 2) += errors.principal_point * numbers.normal() * k(0, 0);
  k(1, 2) += errors.principal_point * numbers.normal() * k(1, 1);
  k.topLeftCorner<2, 2>() *= 1.0 + errors.focal * numbers.normal();
  std::vector<double> deviations(world.pairs.size(), kUnaligned);
  std::fill_n(deviations.begin(), world.right, 1.0);
  input.deviations = &deviations;
  estimator.estimate(world.pairs, input, found);
}

/// Normalised squared error of the parameters: `freedom` of them have an error, 3 for the rotation
/// alone.
inline double normalisedError(const World& world, const RelativePose& pose,
                              const Covariance6& covariance, int freedom) {
  Eigen::Matrix<double, 6, 1> error;
  const Eigen::AngleAxisd turn(world.pose.rotation * pose.rotation.transpose());
  error << world.pose.translation - pose.translation, turn.angle() * turn.axis();
  if (freedom == 3) {
    const Eigen::Matrix3d of_turn = covariance.bottomRightCorner<3, 3>();
    return error.tail<3>().dot(of_turn.inverse() * error.tail<3>());
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver(
      (Eigen::Matrix<double, 6, 6>(covariance)));
  const Eigen::Matrix<double, 6, 1> parts = solver.eigenvectors().transpose() * error;
  double sum = 0.0;
  for (int i = 6 - freedom; i < 6; ++i) sum += parts[i] * parts[i] / solver.eigenvalues()[i];
  return sum;
}

inline double normalisedError(const World& world, const TwoView& found, int freedom) {
  if (found.status != Status::ok) return std::numeric_limits<double>::infinity();
  return normalisedError(world, found.pose, found.pose_covariance, freedom);
}

/// How a motion compares with the truth.
struct Judgement {
  bool right = false;    ///< there is a motion, and it is off by at most 5 degrees
  bool wrong = false;    ///< there is a motion, and it is off by more
  bool certain = false;  ///< wrong, the truth is beyond the bound of 99.9 %, and there is no doubt
};

inline Judgement judged(const World& world, const TwoView& found) {
  constexpr double kOff = 5.0 * 0.017453292519943295;
  constexpr double kKnown = 0.5;  // rad; a direction that is less certain claims nothing
  Judgement judgement;
  if (found.status != Status::ok) return judgement;
  const bool turned = found.geometry == Geometry::rotation;
  const bool still = world.pose.translation.isZero(0.0);
  const double across = std::sqrt(found.pose_covariance.topLeftCorner<3, 3>().trace());
  bool wrong = world.turnError(found.pose) > kOff;
  bool outside = !(normalisedError(world, found, 3) < 16.27);
  if (!turned && !still) {
    wrong = wrong || world.directionError(found.pose) > kOff;
    outside = !(normalisedError(world, found, 5) < 20.52);
  } else if (!turned) {
    wrong = outside = wrong || across < kKnown;
  }
  return {!wrong, wrong, wrong && outside && found.doubt == Doubt::none};
}

}  // namespace ktgp_orb::two_view
