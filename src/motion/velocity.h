#pragma once

#include <cstdint>
#include <optional>

#include "ktgp_orb/ground_motion.h"
#include "motion/ground_filter.h"
#include "motion/noise.h"

namespace ktgp_orb::motion {

/// The velocity of the camera, from pose to pose, and whether a new pose can follow it: the
/// homography may be off by a period of repetitive ground.
class Velocity {
 public:
  /// Starts without a velocity: the camera may stand still or move.
  void start(const GroundMotionOptions& options);
  /// Forgets the last velocity: the next pose does not follow from the one it led to.
  void interrupt() { is_measured_ = false; }
  void beginKeyframe() { noise_.beginKeyframe(); }
  /// Measures the velocity from the pose before to the pose now. `seconds`: between them;
  /// `since_last`: since the last velocity. `is_flat`: the noise of the pictures shows in it, see
  /// TwistNoise.
  void measure(const GroundFilter& filter, double seconds, double since_last, double acceleration,
               bool is_flat);

  /// Velocity (m/s) and angular velocity (rad/s) of the camera in its own frame.
  const Vector6& twist() const { return twist_; }
  const Matrix6& covariance() const { return covariance_; }
  /// The readings of a frame, predicted for its reference, `seconds` before it, by the velocity
  /// that was measured `gap` seconds before the frame.
  GroundFrame atReference(GroundFrame frame, double seconds, double gap,
                          const GroundMotionOptions& options) const;

  /// Writes the twist of the base to `estimate`.
  void report(const GroundMotionOptions& options, GroundEstimate& estimate) const;

  /// Whether the pose now is farther from where the last velocity leads than a vehicle can go.
  bool isJump(const GroundFilter& filter, double seconds, double since_last) const;
  /// Whether the pose of the frame at `stamp`, which is a jump, and those of the frames just before
  /// it, which were refused, are one motion. Then the velocity before them is of no use any more.
  /// `before`: stamp of the frame before. `is_measured`: the filter has the pose of that frame, so
  /// it gives the velocity; otherwise it has the pose of the last frame that was not refused.
  bool isBelieved(const GroundFilter& filter, std::int64_t stamp, std::int64_t before,
                  std::int64_t keyframe_stamp, bool is_measured);

 private:
  double largestChange(const GroundFilter& filter, double seconds, double since_last) const;

  Vector6 twist_ = Vector6::Zero();
  Matrix6 covariance_ = Matrix6::Zero();
  bool is_measured_ = false;  // a velocity was measured since the last gap
  TwistNoise noise_;
  // The newest refused frame.
  std::int64_t refused_stamp_ = 0;
  std::int64_t refused_keyframe_ = 0;
  Eigen::Vector3d refused_position_ = Eigen::Vector3d::Zero();  // in the filter's frame
  std::optional<Eigen::Vector3d> refused_velocity_;             // in the camera's frame
  int agree_ = 0;  // refused frames one after the other that continue each other
};

}  // namespace ktgp_orb::motion
