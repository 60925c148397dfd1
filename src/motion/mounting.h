#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "ktgp_orb/ground_motion.h"
#include "motion/ground_filter.h"

namespace ktgp_orb::motion {

/// Finds how an Imu is mounted and stamped, from the difference between its readings and the
/// rotation that the pictures show.
///
/// The readings of the Imu are turned into each new frame by the rotation of the pictures. The sum
/// of its turns, or its direction n to the ground, is constant then, but for the mounting m, the
/// delay d, the bias b and the relative error s of the scale. To first order these change it by
/// m - w d + b t + s a for turns, where w is the angular velocity and a the turn so far, and by
/// n x (m - b t) + (w x n) d for directions. For directions, b is a drift of the pictures. A wrong
/// normal adds three unknowns. The constant drops out of the difference of the means of successive
/// blocks of half a second. The eleven unknowns follow by weighted least squares that forget within
/// five minutes, the noise from the residuals.
class Mounting {
 public:
  /// A frame `seconds` after the last one. `seen`: the rotation since the frame at
  /// `reference_stamp`, ns; that is the reference of the last frame, or the last frame. Without
  /// `turn`, the direction is used.
  void add(const SeenTurn& seen, std::int64_t reference_stamp, double seconds,
           const std::optional<TurnReading>& turn, const std::optional<DownReading>& down);
  /// Call it after each frame. A frame without add() begins a new sum; the estimates stay.
  void endFrame();
  /// The estimate in the base frame; `to_base`: camera -> base.
  std::optional<ImuMounting> estimate(const Eigen::Matrix3d& to_base) const;
  /// Deviation that a delay and the mounting, where the pictures show them, add to a turn of
  /// the Imu, rad. `change`: of the angular velocity since the turn before, rad/s.
  double doubtOf(const Eigen::Vector3d& turn, double change, const Eigen::Matrix3d& to_base) const;

 private:
  static constexpr int kMounting = 0, kDelay = 3, kBias = 4, kTilt = 7, kScale = 10, kSize = 11;
  using Unknowns = Eigen::Matrix<double, kSize, 1>;
  using Information = Eigen::Matrix<double, kSize, kSize>;
  using Slope = Eigen::Matrix<double, 3, kSize>;
  /// A reading of the Imu, and its derivatives by the unknowns.
  struct Said {
    Eigen::Vector3d value = Eigen::Vector3d::Zero();
    Slope slope = Slope::Zero();
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // covariance of the noise

    void turn(const Eigen::Matrix3d& by);
    void add(const Said& other);
    Said mean(int count) const;
  };

  void begin(const SeenTurn& seen, std::int64_t reference_stamp, bool gives_turns);
  void endBlock();
  static void dropNoise(double variance, Slope& slope);
  void learn(Said difference);
  void solve();

  bool was_added_ = false;    // this frame has been added
  bool is_running_ = false;   // the last frame was added
  bool gives_turns_ = false;  // whether the Imu gives turns; otherwise it gives directions
  int without_turn_ = 0;      // frames, one after the other
  SeenTurn last_;             // turn of the last frame
  std::int64_t reference_stamp_ = 0;
  Eigen::Vector3d rate_ = Eigen::Vector3d::Zero();  // rad/s
  Said turned_;                 // the turns of the Imu since the start, less those of the pictures
  Said block_;                  // sum over the block
  int count_ = 0;               // number of frames in the block
  double seconds_ = 0.0;        // length of the block
  std::optional<Said> before_;  // mean of the block before

  Information information_ = Information::Zero();
  Unknowns weighted_ = Unknowns::Zero();
  double square_ = 0.0;  // sum of squared residuals, in units of their noise
  double rows_ = 0.0;    // number of measurements in `square_`
  double noise_ = 1.0;   // variance of the residuals, as a multiple of the one that was given
  Unknowns unknowns_ = Unknowns::Zero();
  Information covariance_ = Information::Identity();
};

}  // namespace ktgp_orb::motion
