#include "motion/velocity.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "util/small_matrix.h"

namespace ktgp_orb::motion {
namespace {

using util::propagated;

/// Returns the mean velocity of the camera since the previous pose, m/s, in the camera's frame at
/// the previous pose.
Eigen::Vector3d newestVelocity(const GroundFilter& filter, double seconds) {
  const CameraPose& before = filter.before();
  return before.axes.transpose() * (filter.now().position - before.position) / seconds;
}

}  // namespace

void Velocity::start(const GroundMotionOptions& options) {
  twist_.setZero();
  covariance_.setZero();
  covariance_.diagonal().head<3>().setConstant(std::pow(options.acceleration, 2));
  covariance_.diagonal().tail<3>().setConstant(std::pow(options.turn_acceleration, 2));
}

void Velocity::coast(double seconds, const GroundMotionOptions& options) {
  covariance_.diagonal().head<3>().array() += std::pow(options.acceleration * seconds, 2);
  covariance_.diagonal().tail<3>().array() += std::pow(options.turn_acceleration * seconds, 2);
}

void Velocity::measure(const GroundFilter& filter, double seconds, double since_last,
                       double acceleration, bool is_flat) {
  const Vector6 last = twist_;
  const Matrix6 last_covariance = covariance_;
  twist_ = constantTwist(filter.before(), filter.now()) / seconds;
  const Matrix612 slope = twistSlope(filter.before(), filter.now()) / seconds;
  covariance_ = propagated(slope, filter.covarianceOfBoth());
  const Matrix6 noise = propagated(slope, filter.noiseOfBoth());
  noise_.add(twist_, noise, seconds, filter.now().position.z());
  if (is_flat) covariance_ -= noise - noise_.scaled(noise);
  if (!std::exchange(is_measured_, true)) return;
  // A Kalman update that uses the last velocity as a measurement of the new velocity. Its variance
  // is enlarged, because the camera may have accelerated since then. The update matters if the
  // images tell little about the motion, for example near the ground, where few features are in
  // view and a rotation looks like a translation.
  const Eigen::Matrix3d to_now = filter.now().axes.transpose() * filter.before().axes;
  const Eigen::Vector3d change = to_now * last.head<3>() - twist_.head<3>();
  Eigen::Matrix3d covariance = covariance_.topLeftCorner<3, 3>();
  covariance += to_now * last_covariance.topLeftCorner<3, 3>() * to_now.transpose();
  covariance.diagonal().array() += std::pow(acceleration * since_last, 2);
  const Eigen::Matrix<double, 6, 3> gain = covariance_.leftCols<3>() * covariance.inverse();
  twist_ += gain * change;
  covariance_ -= gain * covariance_.topRows<3>();
}

void Velocity::report(const GroundMotionOptions& options, GroundEstimate& estimate) const {
  const Eigen::Matrix3d to_base = options.camera_to_base.linear();
  const Eigen::Vector3d lever = options.camera_to_base.inverse().translation();
  Matrix6 slope = Matrix6::Zero();
  slope.topLeftCorner<3, 3>() = to_base;
  slope.topRightCorner<3, 3>() = -to_base * crossed(lever);
  slope.bottomRightCorner<3, 3>() = to_base;
  const double scale_variance = options.scale_deviation * options.scale_deviation;
  estimate.twist = slope * twist_;
  // An error of the scale changes the velocity of the camera, but not the lever.
  const Eigen::Vector3d velocity = to_base * twist_.head<3>();
  estimate.twist_covariance = propagated(slope, covariance_);
  estimate.twist_covariance.topLeftCorner<3, 3>() +=
      scale_variance * velocity * velocity.transpose();
}

/// Returns the largest plausible change of velocity, m/s. It allows for the acceleration of a
/// vehicle, for the uncertainty of the last velocity, and for noise in the images: at a large
/// height, one or two pixels are several metres.
double Velocity::largestChange(const GroundFilter& filter, double seconds,
                               double since_last) const {
  constexpr double kSpeed = 0.5;          // m/s
  constexpr double kPicture = 0.003;      // noise of a pixel or two, rad
  constexpr double kAcceleration = 10.0;  // m/s²
  constexpr double kDeviations = 4.0;
  const double deviation = std::sqrt(covariance_.topLeftCorner<3, 3>().trace());
  return std::max(kSpeed, kPicture * filter.now().position.z() / seconds) +
         kAcceleration * since_last + kDeviations * deviation;
}

bool Velocity::isJump(const GroundFilter& filter, double seconds, double since_last) const {
  if (!is_measured_) return false;
  constexpr double kDeviations = 4.0;
  const double change = (newestVelocity(filter, seconds) - twist_.head<3>()).norm();
  const double largest = largestChange(filter, seconds, since_last);
  if (change < largest) return false;
  const Matrix612 slope = twistSlope(filter.before(), filter.now()) / seconds;
  const Matrix6 covariance = propagated(slope, filter.covarianceOfBoth());
  const double deviation = std::sqrt(covariance.topLeftCorner<3, 3>().trace());
  return !(change < largest + kDeviations * deviation);
}

bool Velocity::isBelieved(const GroundFilter& filter, std::int64_t stamp, std::int64_t before,
                          std::int64_t keyframe_stamp, bool is_measured) {
  constexpr int kFrames = 3;
  const double seconds = 1e-9 * static_cast<double>(stamp - before);
  const CameraPose& now = filter.now();
  const bool follows = refused_stamp_ == before && agree_ > 0;
  std::optional<Eigen::Vector3d> velocity;
  if (is_measured) {
    velocity = newestVelocity(filter, seconds);
  } else if (follows && refused_keyframe_ == keyframe_stamp) {
    velocity = now.axes.transpose() * (now.position - refused_position_) / seconds;
  }
  const bool agrees = follows && (!velocity || !refused_velocity_ ||
                                  (*velocity - *refused_velocity_).norm() <
                                      largestChange(filter, seconds, seconds));
  refused_stamp_ = stamp;
  refused_keyframe_ = keyframe_stamp;
  refused_position_ = now.position;
  refused_velocity_ = velocity;
  agree_ = agrees ? agree_ + 1 : 1;
  if (agree_ < kFrames) return false;
  agree_ = 0;
  return true;
}

}  // namespace ktgp_orb::motion
