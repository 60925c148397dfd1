#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "ktgp_orb/ground_motion.h"
#include "motion/camera_pose.h"

/// Estimates the noise of measurements from their residuals.
namespace ktgp_orb::motion {

/// How a measurement differs from its prediction.
struct Innovation {
  double misfit = 0.0;  ///< difference from the prediction, in standard deviations
  /// Squared residual minus the part that the uncertainty of the prediction explains, divided by
  /// the given variance of the measurement. Its mean is 1 if the given variance is right.
  double noise = 0.0;
};

/// Returns the factor by which to enlarge the variance of a measurement with `dimensions`
/// components whose misfit is `misfit` standard deviations. It follows from the weight of Student's
/// t distribution with four degrees of freedom (Lange, Little & Taylor, JASA 1989), and is 1 within
/// normal noise.
double studentNoise(double misfit, int dimensions);

/// Estimates the noise of one kind of measurement from its innovations by covariance matching
/// (Mehra, IEEE Trans. AC 1972). The estimate is never below the given variance.
struct Innovations {
  double variance = 1.0;   // running mean of Innovation::noise, as a multiple of the given variance
  int contradictions = 0;  // number of successive contradictions, each on different ground
  bool is_another = false;   // true if the newest measurement is a new contradiction
  std::int64_t ground = -1;  // identifies the ground of the newest measurement
  // Newest residual, in units of the given deviation.
  Eigen::Vector3d residual = Eigen::Vector3d::Zero();
  std::array<double, 2> steps{};  // squared differences of successive residuals, the newest first
  // Running mean of the smallest of the last three squared differences, divided by its expected
  // value; see addResidual().
  double scatter = 0.0;

  /// Adds the innovation of a measurement. `on`: identifies the ground below. Contradictions on the
  /// same ground have the same cause, so they count once.
  void add(const Innovation& innovation, std::int64_t on) {
    constexpr double kMeasurements = 30.0;
    constexpr double kMost = 100.0;  // upper limit of `innovation.noise`, because of outliers
    // A measurement with a larger misfit, in standard deviations, is a contradiction.
    constexpr double kDoubt = 4.0;
    variance += (std::clamp(innovation.noise, 0.0, kMost) - variance) / kMeasurements;
    const bool contradicts = innovation.misfit > kDoubt;
    if (!contradicts) contradictions = 0;
    is_another = contradicts && (contradictions == 0 || on != ground);
    contradictions += is_another ? 1 : 0;
    ground = on;
  }
  double factor() const { return std::max(1.0, variance); }
  /// Adds a residual, in units of the given deviation, to the estimate of the noise of
  /// DownReadings. Drivers state covariances that are too small, so this noise is estimated from
  /// the differences of successive residuals (von Neumann, 1941), in which a constant error
  /// cancels. The smallest of the last three differences is used, since an outlier makes two large
  /// differences.
  void addResidual(const Eigen::Vector3d& newest) {
    constexpr double kMeasurements = 30.0;
    constexpr double kUsual = 1.48;  // mean of the smallest squared difference if the variance is 1
    const double step = (newest - residual).squaredNorm();
    scatter += (std::min({step, steps[0], steps[1]}) / kUsual - scatter) / kMeasurements;
    steps = {step, steps[0]};
    residual = newest;
  }
  /// Standard deviation of the DownReadings, computed from their scatter, as a multiple of the
  /// given deviation. It is limited to kMost, because a larger scatter is an error of the sensor,
  /// not noise.
  double spread() const {
    constexpr double kMost = 10.0;
    return std::clamp(std::sqrt(scatter), 1.0, kMost);
  }
  /// Variance to add to the state so that the state follows readings that contradict it repeatedly.
  /// A single contradiction has hardly any effect; after about five contradictions the state
  /// follows the readings. The first `ignored` contradictions add nothing.
  double doubt(double residual, int ignored) const {
    constexpr double kShare = 0.02;
    if (!is_another) return 0.0;
    return kShare * std::max(contradictions - ignored, 0) * residual * residual;
  }
};

/// Estimates how far the ground deviates from a plane. Uses how far the points in the images
/// deviate from their homography.
///
/// The points of a single image may deviate from a plane by chance, but relief shows in nearly all
/// images. Over relief, the plane that is fitted to an image differs a little from the mean ground,
/// and the readings of height and normal are relative to the mean ground.
class Relief {
 public:
  /// Adds one image. `deviation`: UncertainHomography::plane_deviation divided by the focal length.
  /// `parallax`: horizontal distance from the keyframe divided by the height of the camera.
  void add(double deviation, double parallax);
  bool isSeen() const;
  /// Over relief, enlarges the deviation of a reading, because the plane that is fitted to an image
  /// is not the mean ground.
  HeightReading widened(HeightReading reading) const;
  DownReading widened(DownReading reading) const;

 private:
  double share_ = 0.0;  // share of the images whose points deviate from a plane
  double size_ = 0.0;   // deviation of the ground from the fitted plane, as a share of the height
};

/// Estimates which share of the covariance of a twist (velocity and angular velocity of the camera)
/// is really noise.
///
/// A part of the error of a homography is the same in successive frames and cancels in a velocity.
/// How large this part is depends on the images, so the covariance of the homography is only an
/// upper limit for the noise of a twist. Over six frames, a camera moves smoothly, so the fourth
/// difference of the successive twists is mostly noise. Rough motion enlarges this difference, so
/// the noise is then overestimated.
///
/// The covariance of a homography grows with the distance from the keyframe, but the part that is
/// the same in successive frames grows, too. So a share that was measured far from one keyframe
/// would be too small near the next keyframe. The first twist from a keyframe shows the noise of
/// two successive images, so no later twist is assumed to be more certain than that.
///
/// Each of three parts of the twist has its own share: turning (the angular velocity), approach
/// (the velocity along the optical axis) and shift (the velocity across the optical axis, given the
/// other two parts).
class TwistNoise {
 public:
  /// Call this before the first twist from a new keyframe. The errors of this twist include the
  /// errors of the keyframe, so add() does not compare it with other twists, but takes from it the
  /// least variance of the next twists.
  void beginKeyframe() { count_ = -1; }
  /// Adds the next twist of the camera, in the camera's own frame. `seconds`: time between its two
  /// poses. `height`: height above the ground, m. `noise`: the part of the twist's covariance that
  /// is independent of other frames.
  void add(const Vector6& twist, const Matrix6& noise, double seconds, double height);
  /// Returns `noise`, the independent part of the newest twist's covariance, scaled by the measured
  /// shares.
  Matrix6 scaled(const Matrix6& noise) const;

 private:
  static constexpr int kTwists = 5;

  /// Starts a new series, because the next twist does not follow the previous twists. If the next
  /// twist is the first from a new keyframe, count_ stays -1.
  void restart() { count_ = std::min(count_, 0); }

  std::array<Vector6, kTwists> twists_;  // newest twist first
  int count_ = -1;  // number of successive twists, not counting the first twist of a keyframe
  double seconds_ = 0.0;
  // Running means of the shares of turning, approach and shift, over 30 and over 300 twists.
  Eigen::Array3d newer_ = Eigen::Array3d::Ones();
  Eigen::Array3d older_ = Eigen::Array3d::Ones();
  // Variances of the three parts of the keyframe's first twist, with the noise of both images; see
  // partsOf().
  Eigen::Array3d first_ = Eigen::Array3d::Zero();
  // Lower limit of the shares: `first_` divided by the variances of the newest twist.
  Eigen::Array3d least_ = Eigen::Array3d::Zero();
  double learned_ = 0.0;  // number of twists in the running means, at most 300
};

}  // namespace ktgp_orb::motion
