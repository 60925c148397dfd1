#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "ktgp_orb/ground_motion.h"
#include "motion/ground_filter.h"

namespace ktgp_orb::motion {

/// Finds how an Imu is mounted and how late its stamps are, from the difference between its
/// readings and the rotation that the images show.
///
/// At each new frame, the sums of all earlier readings are rotated into the camera's frame at the
/// newest image, by the rotation that the images show. For a perfect Imu, two vectors then stay
/// constant: the sum of its rotations minus the rotations seen in the images, and its measured
/// direction n to the ground. They change if the Imu has a mounting error m (rad), a delay d (s), a
/// bias b (rad/s) or a relative scale error s. To first order, after a time t, the sum of rotations
/// has changed by m - w d + b t + s a, where w is the angular velocity and a is the rotation so
/// far. The direction has changed by n x (m - b t) + (w x n) d; in this formula, b is not a bias of
/// the Imu but a drift of the rotations seen in the images. A wrong normal of the ground adds three
/// unknowns, which makes eleven in total. The readings are averaged over blocks of half a second;
/// in the difference between the means of successive blocks, the constant part of each vector
/// cancels. Weighted least squares with a memory of five minutes estimates the unknowns from these
/// differences, and the residuals give the noise. If a second fit with a memory of 20 s contradicts
/// the first, the Imu or the slope of the ground has probably changed, and both begin anew.
class Mounting {
 public:
  /// Adds a frame, `seconds` after the previous frame. `seen`: the rotation since the frame at
  /// `reference_stamp` (ns), which is the previous frame or the reference of the previous frame.
  /// `down` is used if `turn` is empty.
  void add(const SeenTurn& seen, std::int64_t reference_stamp, double seconds,
           const std::optional<TurnReading>& turn, const std::optional<DownReading>& down);
  /// Call this after each frame. If add() was not called for the frame, the sums of readings start
  /// anew at the next add(); the estimates stay.
  void endFrame();
  /// The estimate in the base frame; empty if the motion so far does not determine any of the
  /// unknowns. `to_base`: rotation from the camera to the base.
  std::optional<ImuMounting> estimate(const Eigen::Matrix3d& to_base) const;
  /// Size of the error, rad, that the delay and the wrong mounting of the Imu cause in a
  /// TurnReading; add its square to the reading's variance. Estimates that may be due to noise do
  /// not count. `turn`: rotation vector of the reading, rad. `change`: change of the angular
  /// velocity since the previous TurnReading, rad/s.
  double doubtOf(const Eigen::Vector3d& turn, double change, const Eigen::Matrix3d& to_base) const;

 private:
  static constexpr int kMounting = 0, kDelay = 3, kBias = 4, kTilt = 7, kScale = 10, kSize = 11;
  using Unknowns = Eigen::Matrix<double, kSize, 1>;
  using Information = Eigen::Matrix<double, kSize, kSize>;
  using Slope = Eigen::Matrix<double, 3, kSize>;
  /// A reading of the Imu (or a sum of readings), and its derivatives with respect to the unknowns.
  struct Said {
    Eigen::Vector3d value = Eigen::Vector3d::Zero();
    Slope slope = Slope::Zero();
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // covariance of the noise

    void turn(const Eigen::Matrix3d& by);
    void add(const Said& other);
    Said mean(int count) const;
  };

  /// Weighted least squares for the unknowns, with a memory.
  struct Fit {
    Information information = Information::Zero();
    Unknowns weighted = Unknowns::Zero();
    double square = 0.0;  // weighted sum of squares of the measured differences
    double rows = 0.0;    // number of measurements in `square`
    double noise = 1.0;   // variance of the residuals, as a multiple of the given variance
    Unknowns unknowns = Unknowns::Zero();
    Information covariance = Information::Identity();

    static void dropNoise(double variance, Slope& slope);
    /// `freedom`: degrees of freedom of the difference. `kept`: factor of the earlier measurements.
    void learn(Said difference, int freedom, double kept);
    void solve();
  };

  void begin(const SeenTurn& seen, std::int64_t reference_stamp, bool gives_turns);
  void endBlock();
  bool contradict() const;  // of the two fits

  bool was_added_ = false;    // true if add() was called for this frame
  bool is_running_ = false;   // true if add() was called for the last frame
  bool gives_turns_ = false;  // true if the Imu gives TurnReadings, false for DownReadings
  int without_turn_ = 0;      // number of successive frames without a TurnReading
  SeenTurn last_;             // rotation from the keyframe to the last image
  std::int64_t reference_stamp_ = 0;
  Eigen::Vector3d rate_ = Eigen::Vector3d::Zero();  // rad/s
  Said turned_;  // sum of the Imu's rotations since begin(), minus the rotations seen in the images
  Said block_;   // sum of the readings of the present block
  int count_ = 0;               // number of frames in the present block
  double seconds_ = 0.0;        // duration of the present block, s
  std::optional<Said> before_;  // mean of the readings of the previous block

  Fit fit_;     // reported
  Fit recent_;  // with the shorter memory
};

}  // namespace ktgp_orb::motion
