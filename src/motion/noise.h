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
  double misfit = 0.0;  ///< difference in standard deviations
  /// Squared residual less the share that the uncertainty of the prediction explains, divided by
  /// the given variance. Its mean is 1 if that variance is right.
  double noise = 0.0;
};

/// Factor by which to enlarge the variance of a measurement whose misfit is `misfit` standard
/// deviations. It follows from the weight of Student's t distribution with four degrees of freedom
/// (Lange, Little & Taylor, JASA 1989), and is 1 within normal noise.
double studentNoise(double misfit, int dimensions);

/// Estimates the noise of one kind of measurement from its innovations: covariance matching
/// (Mehra, IEEE Trans. AC 1972), never below the variance that was given.
struct Innovations {
  double variance = 1.0;     // running mean, as a multiple of the given variance
  int contradictions = 0;    // successive contradictions, each on different ground
  bool is_another = false;   // the newest measurement is a new contradiction
  std::int64_t ground = -1;  // ground of the newest measurement
  Eigen::Vector3d residual = Eigen::Vector3d::Zero();  // newest residual, in given deviations
  std::array<double, 2> steps{};  // squared differences of successive residuals, newest first
  double scatter = 0.0;           // running mean of the smallest step, see addResidual()

  /// `on`: number of the ground below. Contradictions on the same ground have the same cause, so
  /// they count once.
  void add(const Innovation& innovation, std::int64_t on) {
    constexpr double kMeasurements = 30.0;
    constexpr double kMost = 100.0;  // limit of the noise of a single measurement
    constexpr double kDoubt = 4.0;   // standard deviations
    variance += (std::clamp(innovation.noise, 0.0, kMost) - variance) / kMeasurements;
    const bool contradicts = innovation.misfit > kDoubt;
    if (!contradicts) contradictions = 0;
    is_another = contradicts && (contradictions == 0 || on != ground);
    contradictions += is_another ? 1 : 0;
    ground = on;
  }
  double factor() const { return std::max(1.0, variance); }
  /// Drivers state covariances that are too small. So the noise of normals is estimated from the
  /// differences of successive residuals (von Neumann, 1941), in which a constant error cancels.
  /// The smallest of three differences is used, since an outlier makes two large differences.
  void addResidual(const Eigen::Vector3d& newest) {
    constexpr double kMeasurements = 30.0;
    constexpr double kUsual = 1.48;  // mean of the smallest square, for variance 1
    const double step = (newest - residual).squaredNorm();
    scatter += (std::min({step, steps[0], steps[1]}) / kUsual - scatter) / kMeasurements;
    steps = {step, steps[0]};
    residual = newest;
  }
  /// Standard deviation of the normals by their scatter, as a multiple of the given deviation. A
  /// scatter beyond kMost is an error, not noise.
  double spread() const {
    constexpr double kMost = 10.0;
    return std::clamp(std::sqrt(scatter), 1.0, kMost);
  }
  /// Variance to add to the state so that it follows readings that contradict it repeatedly. A
  /// single contradiction has hardly any effect, and after about five the state follows the
  /// readings. The first `ignored` contradictions add nothing.
  double doubt(double residual, int ignored) const {
    constexpr double kShare = 0.02;
    if (!is_another) return 0.0;
    return kShare * std::max(contradictions - ignored, 0) * residual * residual;
  }
};

/// How far the ground is from flat, estimated from the deviations of pictures from a plane.
///
/// A single picture may deviate from a plane by chance, but relief shows in nearly all pictures.
/// The plane in a picture then differs a little from the mean ground, to which the readings refer.
class Relief {
 public:
  /// `deviation`: deviation of the picture from a plane, for a focal length of 1. `parallax`:
  /// distance from the keyframe, as a share of the height.
  void add(double deviation, double parallax);
  bool isSeen() const;
  /// Enlarges the deviation of a reading, because the seen plane is not the mean ground.
  HeightReading widened(HeightReading reading) const;
  DownReading widened(DownReading reading) const;

 private:
  double share_ = 0.0;  // share of the pictures that deviate from a plane
  double size_ = 0.0;   // deviation of the ground from the seen plane, as a share of the height
};

/// Share of the covariance of a twist that is really noise.
///
/// A part of the error of a homography is the same in successive frames and cancels in a velocity.
/// How large this part is depends on the pictures, so the covariance of the homography is only an
/// upper limit. Over six frames a camera moves smoothly, but noise does not: the fourth difference
/// of successive twists is noise. Rough motion adds to this difference, so the noise is never
/// underestimated.
///
/// Three parts of the twist have their own share: turning, approach and shift. Shift is the motion
/// along the picture that remains once turning and approach are known.
class TwistNoise {
 public:
  /// Announces the first twist from a new keyframe. Its errors include the errors of the keyframe.
  void beginKeyframe() { count_ = -1; }
  /// Adds the next twist of the camera in its own frame, over `seconds`, at this height. `noise`:
  /// the part of the twist's covariance that is independent of other frames.
  void add(const Vector6& twist, const Matrix6& noise, double seconds, double height);
  /// `noise` of the newest twist, scaled by the measured shares.
  Matrix6 scaled(const Matrix6& noise) const;

 private:
  static constexpr int kTwists = 5;

  /// Starts a new series, because the next twist does not follow the previous twists. If the first
  /// twist of a keyframe has not come yet, it is still expected.
  void restart() { count_ = std::min(count_, 0); }

  std::array<Vector6, kTwists> twists_;  // newest twist first
  int count_ = -1;  // number of successive twists, without the first twist of a keyframe
  double seconds_ = 0.0;
  // Running means of the shares over 30 and over 300 twists: turning, approach and shift.
  Eigen::Array3d newer_ = Eigen::Array3d::Ones();
  Eigen::Array3d older_ = Eigen::Array3d::Ones();
  double learned_ = 0.0;  // number of twists so far
};

}  // namespace ktgp_orb::motion
