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

/// How a measurement differs from what was expected.
struct Innovation {
  double misfit = 0.0;  ///< standard deviations
  /// Mean square of the noise that this measurement shows: 1 on average if its variance is right.
  double noise = 0.0;
};

/// Factor on the variance of a measurement that differs from the expectation by `misfit` standard
/// deviations: from the weight of Student's t distribution with four degrees of freedom (Lange,
/// Little & Taylor, JASA 1989); 1 within normal noise.
double studentNoise(double misfit, int dimensions);

/// Estimates the noise of one kind of measurement from its innovations: covariance matching
/// (Mehra, IEEE Trans. AC 1972), never below the variance that was given.
struct Innovations {
  double variance = 1.0;     // as a multiple of the given one: running mean
  int contradictions = 0;    // one after the other, each on other ground
  bool is_another = false;   // the newest measurement is one of them
  std::int64_t ground = -1;  // ground of the newest measurement
  Eigen::Vector3d residual = Eigen::Vector3d::Zero();  // newest residual, in given deviations
  std::array<double, 2> steps{};  // squared, to the newest one and to the one before
  double scatter = 0.0;           // running mean of the smaller steps, see addResidual()

  /// `on`: a number for the ground that the measurement is about. Contradictions on the same ground
  /// have the same cause, so they count once.
  void add(const Innovation& innovation, std::int64_t on) {
    constexpr double kMeasurements = 30.0;
    constexpr double kMost = 100.0;  // limit of a single one
    constexpr double kDoubt = 4.0;   // deviations
    variance += (std::clamp(innovation.noise, 0.0, kMost) - variance) / kMeasurements;
    const bool contradicts = innovation.misfit > kDoubt;
    if (!contradicts) contradictions = 0;
    is_another = contradicts && (contradictions == 0 || on != ground);
    contradictions += is_another ? 1 : 0;
    ground = on;
  }
  double factor() const { return std::max(1.0, variance); }
  /// Drivers give covariances that are too small, so the noise of normals is estimated from the
  /// differences of successive ones (von Neumann, 1941); a constant error does not show in these.
  /// The smallest of three successive steps is used, since an outlier makes two large ones.
  void addResidual(const Eigen::Vector3d& newest) {
    constexpr double kMeasurements = 30.0;
    constexpr double kUsual = 1.48;  // mean of such a square, for variance 1
    const double step = (newest - residual).squaredNorm();
    scatter += (std::min({step, steps[0], steps[1]}) / kUsual - scatter) / kMeasurements;
    steps = {step, steps[0]};
    residual = newest;
  }
  /// Deviation that the normals show, in given deviations. A larger scatter than kMost is an error,
  /// not noise.
  double spread() const {
    constexpr double kMost = 10.0;
    return std::clamp(std::sqrt(scatter), 1.0, kMost);
  }
  /// Variance to add to the state so that it follows readings that contradict it repeatedly: a
  /// single one has hardly any effect, and after about five the state follows them. The first
  /// `ignored` ones add nothing.
  double doubt(double residual, int ignored) const {
    constexpr double kShare = 0.02;
    if (!is_another) return 0.0;
    return kShare * std::max(contradictions - ignored, 0) * residual * residual;
  }
};

/// How far the ground is from flat, as far as the deviation of pictures from a plane tells it.
///
/// A single picture deviates from a plane by chance, too; relief shows in nearly all of them. Then
/// the picture shows a plane that is not quite the mean ground to which the readings refer.
class Relief {
 public:
  /// `deviation` from a plane, for a focal length of 1; `parallax`: distance from the keyframe, as
  /// a share of the height.
  void add(double deviation, double parallax);
  bool isSeen() const;
  /// The reading, widened by the deviation of the seen plane from the mean ground.
  HeightReading widened(HeightReading reading) const;
  DownReading widened(DownReading reading) const;

 private:
  double share_ = 0.0;  // share of the pictures that deviate from a plane
  double size_ = 0.0;   // standard deviation of the ground from the seen plane, share of the height
};

/// How large the noise of a twist is, compared with its covariance.
///
/// The covariance of a homography is right for the homography. A part of its error is alike from
/// frame to frame and cancels in a velocity, and how large that part is depends on the pictures.
/// But over six frames a camera moves smoothly, and noise does not: the fourth difference of
/// successive twists is noise, plus motion where that is rough. So the noise never looks too small,
/// and the covariance is its upper limit.
///
/// Turning, approach and shift (what is left of the two velocities along the picture when turning
/// and approach are known) have each their own share.
class TwistNoise {
 public:
  /// The next twist is the first one from a keyframe. It has the errors of the keyframe, too.
  void beginKeyframe() { count_ = -1; }
  /// The next twist of the camera in its own frame, over `seconds`, at this height. `noise`: the
  /// part of its covariance that is independent of other frames.
  void add(const Vector6& twist, const Matrix6& noise, double seconds, double height);
  /// `noise` of the newest twist, scaled by the measured shares.
  Matrix6 scaled(const Matrix6& noise) const;

 private:
  static constexpr int kTwists = 5;

  /// The next twists do not follow the ones before. If the first twist of a keyframe has not come
  /// yet, it is still expected.
  void restart() { count_ = std::min(count_, 0); }

  std::array<Vector6, kTwists> twists_;  // the newest first
  int count_ = -1;  // number of twists from one keyframe, without the first one
  double seconds_ = 0.0;
  // Running means over 30 and over 300 twists, for turning, approach and shift.
  Eigen::Array3d newer_ = Eigen::Array3d::Ones();
  Eigen::Array3d older_ = Eigen::Array3d::Ones();
  double learned_ = 0.0;  // number of twists so far
};

}  // namespace ktgp_orb::motion
