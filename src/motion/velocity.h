#pragma once

#include <cstdint>
#include <optional>

#include "ktgp_orb/ground_motion.h"
#include "motion/ground_filter.h"
#include "motion/noise.h"

namespace ktgp_orb::motion {

/// The velocity of the camera between successive poses. This class also judges whether a new pose
/// is plausible, because on repetitive ground a homography may be off by one period.
class Velocity {
 public:
  /// Starts without a known velocity: the standard deviation is one second of `acceleration`, in
  /// m/s, and one second of `turn_acceleration`, in rad/s.
  void start(const GroundMotionOptions& options);
  /// Forgets the last velocity, because the next pose is not connected to it.
  void interrupt() { is_measured_ = false; }
  /// Makes the velocity less certain: it was not measured for `seconds`, during which the camera
  /// may have accelerated.
  void coast(double seconds, const GroundMotionOptions& options);
  void beginKeyframe() { noise_.beginKeyframe(); }
  /// Measures the velocity between the filter's last two poses, which are `seconds` apart.
  /// `since_last`: time since the last velocity, s. `acceleration`: see GroundMotionOptions.
  /// `is_flat`: true if the ground is flat. On flat ground the covariance is reduced to the noise
  /// that the twists show, see TwistNoise.
  void measure(const GroundFilter& filter, double seconds, double since_last, double acceleration,
               bool is_flat);

  /// Velocity (m/s) and angular velocity (rad/s) of the camera in its own frame.
  const Vector6& twist() const { return twist_; }
  const Matrix6& covariance() const { return covariance_; }

  /// Writes the twist of the vehicle's base and its covariance to `estimate`.
  void report(const GroundMotionOptions& options, GroundEstimate& estimate) const;

  /// Returns true if the newest pose implies a larger change of velocity than a vehicle can make.
  bool isJump(const GroundFilter& filter, double seconds, double since_last) const;
  /// Returns true if the frame at `stamp`, whose pose is a jump, and the refused frames just before
  /// it (three frames in all) agree on one motion. If they do, the velocity before these frames is
  /// obsolete. `before`: stamp of the previous frame, ns. `is_measured`: true if the filter's
  /// previous pose is the pose of that previous frame and gives a velocity; false if it is the pose
  /// of the last accepted frame.
  bool isBelieved(const GroundFilter& filter, std::int64_t stamp, std::int64_t before,
                  std::int64_t keyframe_stamp, bool is_measured);

 private:
  double largestChange(const GroundFilter& filter, double seconds, double since_last) const;

  Vector6 twist_ = Vector6::Zero();
  Matrix6 covariance_ = Matrix6::Zero();
  bool is_measured_ = false;  // true if a velocity was measured since the last gap
  TwistNoise noise_;
  // The next members describe the newest refused frame.
  std::int64_t refused_stamp_ = 0;
  std::int64_t refused_keyframe_ = 0;
  // Position of the camera in the filter's frame, m.
  Eigen::Vector3d refused_position_ = Eigen::Vector3d::Zero();
  std::optional<Eigen::Vector3d> refused_velocity_;  // velocity of the camera in its own frame, m/s
  int agree_ = 0;  // number of successive refused frames that agree on one motion
};

}  // namespace ktgp_orb::motion
